"""Set-points for real drives: compensation, learning from runs and identification from logs."""
