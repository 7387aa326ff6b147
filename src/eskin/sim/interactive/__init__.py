"""Interactive simulation plays touches without end, computed while they play."""
