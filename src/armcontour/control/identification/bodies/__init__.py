"""Identification of an arm with masses and of its drives; simulates with `robot.drives`."""
