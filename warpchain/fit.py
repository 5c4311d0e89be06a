"""Set-up help: where a sprocket must stand, or how many links a chain must have."""

from warpchain.assembly.fitting import fit_angle, fit_links, fit_position, fit_wrap
from warpchain.assembly.guide_fit import fit_indentation

__all__ = ["fit_angle", "fit_indentation", "fit_links", "fit_position", "fit_wrap"]
