"""This package computes contact: from a press to the pressure on taxels."""
