"""rk4 of bodies at float32 without float64: coordinates and the sums of their slopes are pairs."""

import warp as wp

from ..number import Pair, plus, times
from ..structs import Slope


@wp.func
def staged(number: int, weight: wp.float32, reach: wp.float32, value: Pair, rate: Pair, slope: Slope):
    """A coordinate where the next of the four stages has it, after the fourth at the step's end, as `body.rk4_body`.

    Args:
        number: of the stage that has found `rate`, 0 to 3.
        weight: of it in the sum of slopes [s].
        reach: how far from the step's start the next one is [s].
        value: where the coordinate is.
        rate: how fast it changes there.
        slope: what the stages keep of it; it is returned, too.
    """
    if number == 0:
        slope.base = value
        slope.total = Pair()
    slope.total = plus(slope.total, times(rate, weight))
    if number == 3:
        value = plus(slope.base, slope.total)
    else:
        value = plus(slope.base, times(rate, reach))
    return value, slope
