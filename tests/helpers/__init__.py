"""What tests share: cases, meshes, made records, references in NumPy, comparisons, a browser."""
