"""The panel beside the scene: a tab a file, and the words in it."""
