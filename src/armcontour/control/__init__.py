"""Set-points for real drives: compensation, learning from runs, identification from logs."""
