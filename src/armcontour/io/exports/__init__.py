"""Writers of what robots take: each turns joint set-points and events into one format."""
