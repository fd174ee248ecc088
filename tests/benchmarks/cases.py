"""The cases of `isochrome bench`, in order. Each is a function of `quick` that returns its rows."""

from __future__ import annotations

from . import case_frames, case_memory, case_peers, case_pressure, case_stress, case_wear

CASES = {
    "pressure": case_pressure.pressure,
    "cost with size": case_pressure.cost,
    "peers": case_peers.peers,
    "wear": case_wear.wear,
    "stress": case_stress.stress,
    "frames": case_frames.frames,
    "memory": case_memory.memory,
}
