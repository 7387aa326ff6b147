"""Where on the robot touches take place."""
