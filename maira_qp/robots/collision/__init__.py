"""What a robot and its surroundings are made of, for `coal`: shapes, where they stand, and how far apart they are."""
