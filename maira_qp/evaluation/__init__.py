"""How often, how fast and how exactly: methods against sets of targets, judged by an FK that no solver uses."""
