"""This package makes simulated clips and streams with labels: plans, sets and files."""
