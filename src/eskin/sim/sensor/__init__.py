"""The sensor: from pressures to counts."""
