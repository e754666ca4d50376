"""Files of poses and of the answers to them: CSV, NPY, NPZ and Parquet; whole or absent."""
