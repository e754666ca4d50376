"""What a person touches: the command line, the benchmark, pictures."""
