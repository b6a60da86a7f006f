"""Studio: a local page on which a person moves a path and sees what the robot makes of it."""
