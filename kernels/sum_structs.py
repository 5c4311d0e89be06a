"""What the kernels add up, as Warp structs: contacts at one instant, and sums over the window of the metrics.

All in float64 at every precision, in SI units.
"""

import warp as wp


@wp.struct
class Totals:
    """What the contacts of one sprocket or guide-bar add up to at one instant."""

    moment: wp.float64  # on the sprocket [N m]
    push: wp.vec2d  # force on the sprocket [N]
    force: wp.float64  # sum of magnitudes [N]
    force_max: wp.float64  # [N]
    dissipated: wp.float64  # power [W]
    friction: wp.float64  # power of friction [W]
    energy: wp.float64  # elastic [J]
    impacts: wp.int32  # contacts that began
    contacts: wp.int32  # of them, the first of a roller in its pass
    missed: wp.int32  # rollers that came in not through the face
    missing: wp.int32  # rollers that are in there


@wp.struct
class ContactSums:
    """Sums over the window of one sprocket's or guide-bar's contacts; forces: of watched steps (`sums.WATCH_EVERY`)."""

    force_max: wp.float64  # [N]
    impacts: wp.int32  # contacts that began
    contacts: wp.int32  # of them, the first of a roller in its pass over a sprocket
    missed: wp.int32  # rollers that were in a guide-bar without having come through its face
    impulse: wp.float64  # [N s]
    dissipated: wp.float64  # [J]
    friction: wp.float64  # dissipated by friction, which `dissipated` has not [J]


@wp.struct
class SprocketSums:
    """Sums over the window of a sprocket: moment and work of every step (trapezoidal), the rest of watched steps."""

    speed_min: wp.float64  # [rad/s]
    speed_max: wp.float64
    speed: wp.float64  # [rad]
    speed_square: wp.float64
    moment: wp.float64  # [N m s]
    contact_work: wp.float64  # done by the chain on the sprocket [J]
    load_work: wp.float64  # done by the load moment [J]
    force: wp.vec2d  # of the chain on it [N s]
    force_max: wp.float64  # its largest magnitude [N]


@wp.struct
class MountSums:
    """Sums over the window of a sprocket on an active mount."""

    travel: wp.vec2d  # displacement from the stated center [m s]
    travel_max: wp.float64  # largest distance from it [m]
    force: wp.float64  # magnitude of what holds the center [N s]
    dissipated: wp.float64  # in its damper [J]
    work: wp.float64  # done on sprocket and wheel by what prescribes center and angle [J]


@wp.struct
class ArmSums:
    """Sums over the window of an arm (time integrals, trapezoidal)."""

    angle_min: wp.float64  # [rad]
    angle_max: wp.float64
    angle: wp.float64  # [rad s]
    angle_square: wp.float64
    moment: wp.float64  # of contacts about its pivot [N m s]
    dissipated: wp.float64  # in its damper and stops [J]


def flows_struct(Real: type) -> type:
    """`TensionerFlows` at a precision."""

    @wp.struct
    class TensionerFlows:
        """What flowed through a tensioner in a step, and what became of its energy."""

        leaked: Real  # [m^3]
        supplied: Real  # [m^3]
        leak_loss: Real  # [J]
        valve_loss: Real  # [J]
        supply_work: Real  # [J]
        lift: Real  # y of the valve at the step's end [m]

    return TensionerFlows


TensionerFlows = flows_struct(wp.float64)


@wp.struct
class TensionerSums:
    """Sums over the window of a tensioner (time integrals, trapezoidal), and what flowed between its ends."""

    force_min: wp.float64  # [N]
    force_max: wp.float64
    force: wp.float64  # [N s]
    pressure_min: wp.float64  # [Pa]
    pressure_max: wp.float64
    pressure: wp.float64  # [Pa s]
    extension_min: wp.float64  # [m]
    extension_max: wp.float64
    extension: wp.float64  # [m s]
    dissipated: wp.float64  # in its damper and stop [J]
    flows: TensionerFlows


@wp.struct
class StrandSums:
    """Sums over the looks in the window at one strand: its links' tension, mid-strand transverse displacement."""

    links: wp.int64  # tension samples
    tension_min: wp.float64  # of watched steps [N]
    tension_max: wp.float64
    tension: wp.float64
    tension_square: wp.float64
    samples: wp.int64  # displacement samples
    displacement_min: wp.float64  # [m]
    displacement_max: wp.float64
    displacement: wp.float64
    displacement_square: wp.float64


@wp.struct
class ChainSums:
    """Sums over the window of the whole chain, and the energy balance's two ends."""

    tension_min: wp.float64  # of watched steps [N]
    tension_max: wp.float64
    tension: wp.float64  # sum over links and looks
    tension_square: wp.float64
    samples: wp.int64  # looks in the window
    dissipated: wp.float64  # in the links [J]
    friction: wp.float64  # dissipated in the joints [J]
    energy_start: wp.float64  # mechanical energy at the window's start [J]
    energy_end: wp.float64


@wp.struct
class ChainNote:
    """What `ChainSums` has at a batch's end."""

    tension: wp.float64
    samples: wp.int64


@wp.struct
class StrandNote:
    """What `StrandSums` has at a batch's end."""

    links: wp.int64
    tension: wp.float64
    samples: wp.int64
    displacement: wp.float64


@wp.struct
class SlipSums:
    """Teeth that the chain has jumped over a sprocket in the window, and how that is followed (`kernels.slip`)."""

    slips: wp.int32
    known: wp.int32  # 1: a roller has been seen in mid-wrap
    roller: wp.int32  # which was there at the last look
    place: wp.int32  # of it along the chain, from where the window began, modulo the teeth
    offset: wp.int32  # of its seat from that place, modulo the teeth
    candidate: wp.int32  # the same at the last look


@wp.struct
class LinkTally:
    """What one link added up while it was on one strand, or on none."""

    samples: wp.int64
    tension: wp.float64  # [N]
    tension_square: wp.float64


@wp.struct
class RollerTally:
    """What one link, and joint friction on one roller, dissipated, and energies at the window's two ends.

    They are of the roller, its link and its contacts.
    """

    dissipated: wp.float64  # [J]
    friction: wp.float64  # [J]
    energy_start: wp.float64  # [J]
    energy_end: wp.float64


@wp.struct
class Tallies:
    """Sums that the block kernels keep roller by roller, so that no thread waits for another.

    Those of contacts (`ContactSums`) lie in rows of their own, neighbors' beside each other.
    """

    link: wp.array[LinkTally]  # (sum of (S + 1) N,)
    impacts: wp.array[wp.int32]  # (contact memories,)
    contacts: wp.array[wp.int32]
    missed: wp.array[wp.int32]
    dissipated: wp.array[wp.float64]
    friction: wp.array[wp.float64]
    impulse: wp.array[wp.float64]
    force_max: wp.array[wp.float64]
    roller: wp.array[RollerTally]  # (all rollers,)
    body: wp.array[RollerTally]  # (all bodies,): energy only, of tensioners too


@wp.struct
class Sums:
    """What is added up over the window; S sprockets (and strands) and G guide-bars a variant."""

    chain: wp.array[ChainSums]  # (variants,)
    strand: wp.array[StrandSums]  # (all sprockets,)
    sprocket: wp.array[SprocketSums]  # (all sprockets,)
    mount: wp.array[MountSums]  # (all sprockets,)
    arm: wp.array[ArmSums]  # (all arms,)
    tensioner: wp.array[TensionerSums]  # (all tensioners,)
    contact: wp.array[ContactSums]  # (all sprockets and guide-bars,), a variant's sprockets first
    slip: wp.array[SlipSums]  # (all sprockets,)
    tension_counts: wp.array[wp.int32]  # `tension_bins.BINS` of each strand, then of links on none, variant by variant
    chain_notes: wp.array[ChainNote]  # `batches.NOTES` a variant
    strand_notes: wp.array[StrandNote]  # the same for each sprocket
    sprocket_notes: wp.array[SprocketSums]
    mount_notes: wp.array[MountSums]
