"""What holds for hours, and whatever happens."""
