"""Runs ensembles of drives on CPUs and GPUs; the only users of Warp beside the kernels."""
