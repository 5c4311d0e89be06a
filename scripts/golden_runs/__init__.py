"""What `golden.py` runs: drives, cases over them, and the block kernel on fibers."""
