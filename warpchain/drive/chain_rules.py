"""Rules of drives with several chains, and of sprockets on one shaft."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from warpchain.drive.parts_by_chain import shaft_of_sprocket
from warpchain.drive.schema import BARE, Problem, is_name, nearest_key_text, node_list, node_value, valid_part
from warpchain.drive.sprocket import Sprocket

PARTS_NAMING_CHAINS = ("sprockets", "guides", "probes")
"""Lists of parts that name their chain."""


def chain_rules(drive: Any) -> Iterator[Problem]:
    """Problems of a missing chain, and of parts that name none of several."""
    chains, alone = node_list(drive, "chains"), node_value(drive, "chain")
    if alone is None and not chains:
        yield Problem(("chain",), None, "missing; must be a table, or give a list of chains instead", BARE)
    if alone is not None and chains:
        yield Problem(("chains",), len(chains), "not together with chain; give one of the two")
    names = [node_value(chain, "name") for chain in chains]
    known = list(dict.fromkeys(filter(is_name, names)))
    for kind in PARTS_NAMING_CHAINS:
        for i, part in enumerate(node_list(drive, kind)):
            chain = node_value(part, "chain")
            if chain is not None and not chains:
                yield Problem((kind, i, "chain"), chain, "must not be given where there is one chain, [chain]")
            elif chain is None and chains:
                text = f"missing; must be the name of a chain: {', '.join(known)}"
                yield Problem((kind, i, "chain"), None, text, BARE)
            elif chain is not None and chain not in names:
                text = f"must be the name of a chain; {nearest_key_text(str(chain), known)}"
                yield Problem((kind, i, "chain"), chain, text)
    named = [node_value(sprocket, "chain") for sprocket in node_list(drive, "sprockets")]
    for c, name in enumerate(names):
        count = named.count(name)
        if is_name(name) and count < 2 and all(chain in names for chain in named):
            yield Problem(("chains", c, "name"), name, f"must be named by at least 2 sprockets, is by {count}")
    yield from _arm_chain_rules(drive)


def _arm_chain_rules(drive: Any) -> Iterator[Problem]:
    """Problems of parts of several chains on one arm."""
    seen: dict[Any, Any] = {}
    on = {
        node_value(arm, "name"): node_value(arm, "arm")
        for arm in node_list(drive, "arms")
        if is_name(node_value(arm, "name"))
    }
    places = [("guides", g, guide, node_value(guide, "arm")) for g, guide in enumerate(node_list(drive, "guides"))]
    places += [
        ("sprockets", s, of, node_value(node_value(of, "mount"), "arm"))
        for s, of in enumerate(node_list(drive, "sprockets"))
    ]
    for kind, i, part, of in places:
        chain, arm = node_value(part, "chain"), on.get(of) or of if isinstance(of, str) else None
        if isinstance(arm, str) and isinstance(chain, str) and seen.setdefault(arm, chain) != chain:
            text = f'must be "{seen[arm]}", as of the other guides and sprockets on the arm "{arm}"'
            yield Problem((kind, i, "chain"), chain, text)


def shaft_group_rules(drive: Any) -> Iterator[Problem]:
    """Problems of several chains' sprockets on one shaft."""
    if not node_list(drive, "chains"):
        return
    names = [node_value(shaft, "name") for shaft in node_list(drive, "shafts")]
    groups: dict[str, list[int]] = {name: [] for name in filter(is_name, names)}
    sprockets = node_list(drive, "sprockets")
    for s, sprocket in enumerate(sprockets):
        shaft = node_value(sprocket, "shaft")
        if not isinstance(shaft, str):
            continue
        if shaft not in groups:
            hint = nearest_key_text(shaft, groups) if groups else "there are none"
            yield Problem(("sprockets", s, "shaft"), shaft, f"must be the name of a shaft; {hint}")
            continue
        groups[shaft].append(s)
    for i, name in enumerate(names):
        members = groups.get(name, []) if is_name(name) else []
        yield from _shaft_key_rules(sprockets, members, node_list(drive, "shafts")[i], str(name))
        for s in members[1:]:
            yield from (
                problem.nested_under("sprockets", s)
                for problem in _further_sprocket_rules(sprockets, members, s, str(name))
            )


def _shaft_key_rules(sprockets: Sequence[Any], members: Sequence[int], shaft: Any, name: str) -> Iterator[Problem]:
    """Problems of a shaft's load or motor beside its sprockets'."""
    for s in members:
        if node_value(shaft, "load") is not None and node_value(sprockets[s], "load") is not None:
            text = f'not together with shafts."{name}".load; give one of the two'
            yield Problem(("sprockets", s, "load"), None, text, BARE)
        if node_value(shaft, "motor") is not None and node_value(sprockets[s], "prescribed") is not None:
            text = f'not together with shafts."{name}".motor; give one of the two'
            yield Problem(("sprockets", s, "prescribed"), None, text, BARE)


def _further_sprocket_rules(sprockets: Sequence[Any], members: Sequence[int], s: int, shaft: str) -> Iterator[Problem]:
    """Problems of a shaft's further sprocket: chain, center, wrap, mount."""
    node, first = sprockets[s], sprockets[members[0]]
    before = [sprockets[m] for m in members if m < s]
    own, other = valid_part(Sprocket, node), valid_part(Sprocket, first)
    named = f'as of "{node_value(first, "name")}" on the shaft "{shaft}"'
    if node_value(node, "chain") is not None and any(
        node_value(node, "chain") == node_value(of, "chain") for of in before
    ):
        yield Problem(("shaft",), shaft, "must be one without another sprocket of the same chain")
    if own is None or other is None:
        return
    if own.center != other.center:
        yield Problem(("center",), list(own.center), f"must be {list(other.center)}, {named}")
    if own.wrap != other.wrap:
        text = f'must be "{other.wrap}", {named}: list the sprockets of the chain in the order that then follows'
        yield Problem(("wrap",), own.wrap, text)
    for part in (own, other):
        if part.mount.kind in ("elastic", "slider", "arm"):
            text = f'must be "fixed" or "prescribed", as the shaft "{shaft}" has several sprockets'
            yield Problem(("mount", "kind"), part.mount.kind, text)
            return
    if own.mount != other.mount:
        yield Problem(("mount",), None, f"must be the same {named}", BARE)


def plane_rules(drive: Any) -> Iterator[Problem]:
    """Problems of chains in one plane with sprockets on one shaft."""
    seen: dict[tuple[str, str], Any] = {}
    chains = {
        name: c for c, chain in enumerate(node_list(drive, "chains")) if is_name(name := node_value(chain, "name"))
    }
    for sprocket in node_list(drive, "sprockets"):
        name = node_value(sprocket, "chain")
        if not is_name(node_value(sprocket, "shaft")) or not is_name(name) or name not in chains:
            continue
        plane = node_value(node_list(drive, "chains")[chains[name]], "plane")
        other = seen.setdefault((shaft_of_sprocket(sprocket), plane), name) if isinstance(plane, str) else name
        if other != name:
            text = f'must be another than of the chain "{other}", which has a sprocket on the same shaft'
            yield Problem(("chains", chains[name], "plane"), plane, text)


CHAIN_RULES = (chain_rules, shaft_group_rules, plane_rules)
"""Rules of several chains, in the order of errors."""
