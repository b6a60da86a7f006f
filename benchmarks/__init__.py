"""Speed as ratios to peers in the same run, compared with a baseline of such ratios."""
