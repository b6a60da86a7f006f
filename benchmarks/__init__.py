"""Speed bars, measured as ratios against a peer in the same run."""
