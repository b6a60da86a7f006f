"""Files of robots: the built-in arms, arm files, robot descriptions, limits of MoveIt."""
