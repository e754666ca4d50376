"""What the benchmark of following paths is made of: motions, criterion, contestants, clock and report."""
