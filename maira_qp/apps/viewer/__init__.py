"""The viewer in the browser: an arm, a target to drag, and what the solver says about it."""
