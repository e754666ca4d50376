"""How kernels are compiled, inlined and kept on disk, and numbers eight at a time."""
