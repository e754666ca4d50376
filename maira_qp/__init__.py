"""maira_qp: constrained inverse kinematics by quadratic programming."""

__version__ = "0.1.0"
