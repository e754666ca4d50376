"""Files of poses and of the answers to them: CSV, NPZ and Parquet; whole or absent."""
