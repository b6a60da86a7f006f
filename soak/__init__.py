"""A soak of the optimal planner: random problems, judged by what the planner does not share."""
