"""Why a pose is not reached, and how the answer moves with the target."""
