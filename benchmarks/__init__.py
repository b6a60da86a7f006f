"""Speed, as ratios against a peer in the same run and against a baseline of such ratios."""
