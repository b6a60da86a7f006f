"""What all parts share: checks of fields, how a result is described, how its figures look."""
