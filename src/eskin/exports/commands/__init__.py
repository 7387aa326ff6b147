"""This package holds the commands of exports."""
