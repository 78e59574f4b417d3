"""The season's data set: flights, their rows and their sums as Parquet, on a disk or a bucket."""
