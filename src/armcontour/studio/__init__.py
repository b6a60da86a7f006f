"""The Studio: a local page on which a job is changed while the robot's answer is seen."""
