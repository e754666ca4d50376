"""Where to put an arm: bases ranked by how many tool poses can be reached from each."""
