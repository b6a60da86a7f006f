"""Values that every package has: dataclasses that check their fields."""
