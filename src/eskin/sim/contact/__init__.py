"""Contact: from a press to what taxels feel."""
