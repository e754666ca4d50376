"""The reference engine: any problem, with Pinocchio and a QP solver."""
