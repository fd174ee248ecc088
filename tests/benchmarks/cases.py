"""The cases of `isochrome bench`, in order. Each is a function (quick, say) -> list of rows."""

from __future__ import annotations

from importlib.util import find_spec

from isochrome.bench import Row

from . import case_frames, case_memory, case_pressure, case_stress, case_wear

PEERS = {"tamaas": "tamaas", "ContactMechanics": "ContactMechanics"}


def peers(quick):
    """Optional rivals: a row that says whether they are here."""
    return [
        Row(
            "peers",
            name,
            "installed, but not compared yet" if find_spec(module) else "not installed, not run",
        )
        for name, module in PEERS.items()
    ]


CASES = {
    "pressure": case_pressure.pressure,
    "cost with size": case_pressure.cost,
    "wear": case_wear.wear,
    "stress": case_stress.stress,
    "frames": case_frames.frames,
    "memory": case_memory.memory,
    "peers": peers,
}
