"""The runs of `golden.py`: drives, cases over them, and the block kernel on fibers."""
