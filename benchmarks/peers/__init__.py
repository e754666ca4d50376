"""What the benchmark against other solvers is made of: arms, judge, contestants, clock and report."""
