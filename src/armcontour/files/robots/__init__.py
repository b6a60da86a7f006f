"""Readers of arms: built-in arms, arm files, robot descriptions, and joint limits of MoveIt."""
