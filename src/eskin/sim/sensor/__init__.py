"""This package simulates the sensor, from pressure on taxels to counts."""
