"""One control step: levels, their models, the hierarchical QP, the box of displacements."""
