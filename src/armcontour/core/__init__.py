"""What all parts share: how a result is described, and how its figures look."""
