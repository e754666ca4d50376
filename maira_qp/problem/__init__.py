"""What is asked: targets, tasks, limits, the redundancy's objectives, and the QP levels that they make."""
