"""The time-optimal plan of a path: limits as rows on a grid, one compiled pass, refinement."""
