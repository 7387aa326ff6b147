"""Sets of clips as files."""
