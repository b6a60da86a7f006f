"""Read arms: built-in arms, arm files, robot descriptions, joint limits of MoveIt."""
