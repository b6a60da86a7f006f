"""The share of the variance of a joint's motion that its command explains."""

FOLLOWS = 0.5
