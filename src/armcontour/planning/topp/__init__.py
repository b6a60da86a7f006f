"""The time-optimal plan of a path on one grid: limits as rows, and one compiled pass."""
