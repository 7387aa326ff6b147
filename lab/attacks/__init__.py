"""This package attacks eskin with faults, forgeries, delays and hostile files."""
