"""What the cases measure: a row of a suite's table, each suite its own."""

from dataclasses import dataclass

_NAN = float("nan")


@dataclass(frozen=True)
class Row:
    """One measurement: `case`, `method`, `setting`, `error` and `seconds` (NaN: has none).

    `ratio`: the time of the paper's procedure at the same or smaller error over this row's; with
    `reached` False, the time of its most accurate setting, which is not as good as this row.
    """

    case: str
    method: str
    setting: str
    error: float = _NAN
    seconds: float = _NAN
    ratio: float = _NAN
    reached: bool = True


@dataclass(frozen=True)
class FringeRow:
    """One reading of one specimen's fringe order, against its truth.

    The share `wrong` by over half a fringe, `rms` and `median` error (fringes), of what was kept;
    `kept`, share of the specimen's pixels; `right`, share right to 0.05 fringe of the pixels
    that the method calls 95 % sure; `seconds`. NaN: has none.
    """

    specimen: str
    method: str
    wrong: float = _NAN
    rms: float = _NAN
    median: float = _NAN
    kept: float = _NAN
    right: float = _NAN
    seconds: float = _NAN


@dataclass(frozen=True)
class FitRow:
    """One quantity that a fit found, against the truth.

    `problem`, `case`, `quantity`; its `error`, and the `bar` that it is to stay below,
    both in `unit`; `pull`, error over standard uncertainty, root mean square (NaN: has
    none); `cpu_ms`, processor time of one such fit, and the `evaluations` of the renderer at all
    pixels that would take as long.
    """

    problem: str
    case: str
    quantity: str
    error: float
    bar: float
    unit: str
    pull: float
    cpu_ms: float
    evaluations: float


@dataclass(frozen=True)
class TrackRow:
    """One run of `process` on a film.

    `film`, its kind of file; `workers`; `frames`, and how many a second by the clock; `cpu_ms`,
    processor time of a frame, and the shares of it that `reading` and `writing` took (NaN: spent in
    other processes); `load_error`, relative, and `pull`, error over standard uncertainty, both root
    mean square; `apart_per_s`, frames a second of as many runs of one worker each at the same time,
    which share nothing but the machine (NaN: not measured). Of films without a model: median `rms`
    error (fringes) and `kept` share of the specimen, and the share of what is known that is `wrong`
    by over a quarter of a fringe, of the worst frame.
    """

    film: str
    workers: int
    frames: int
    frames_per_s: float
    cpu_ms: float
    reading: float = _NAN
    writing: float = _NAN
    load_error: float = _NAN
    pull: float = _NAN
    apart_per_s: float = _NAN
    rms: float = _NAN
    kept: float = _NAN
    wrong: float = _NAN


@dataclass(frozen=True)
class MemoryRow:
    """Peak memory of a run in a process of its own.

    `command`; what its `items` are and their `count`; `peak_mb`; `seconds`, by the clock.
    """

    command: str
    items: str
    count: int
    peak_mb: float
    seconds: float


@dataclass(frozen=True)
class ToleranceRow:
    """One random course, its largest pressures and depths beside a run at a hundredth.

    `seed` and `course`, in words; `tolerance`; the largest errors of `p_max` and `depth` over its
    states, each over the tolerance; `refused`, the sentence, or nothing; `seconds`, processor time.
    """

    seed: int
    course: str
    tolerance: float
    p_max: float
    depth: float
    refused: str
    seconds: float


@dataclass(frozen=True)
class DefectRow:
    """One frame of a bench that is not ours, fitted from values that are 20 % off.

    `kind`, `seed`, and its `defects` by name; `found`, those that were, in the order in which they
    are said, whether all were `named`, and whether a true one stood `first` (of three: among the
    first two); `over_bound`, the larger of load's and friction's standard uncertainties over their
    Cramér-Rao bounds; `load_percent`, error of the load; `load_pull`, `friction_pull`, errors over
    their standard uncertainties; `chi`; `flagged`, whether it is said that something is left;
    `cost`, processor time over that of the fit as stated, and `seconds`; `refused`, the sentence,
    or nothing.
    """

    kind: str
    seed: int
    defects: str
    found: str = ""
    named: bool = False
    first: bool = False
    over_bound: float = _NAN
    load_percent: float = _NAN
    load_pull: float = _NAN
    friction_pull: float = _NAN
    chi: float = _NAN
    flagged: bool = False
    cost: float = _NAN
    seconds: float = _NAN
    refused: str = ""


@dataclass(frozen=True)
class BenchRow(DefectRow):
    """One frame of a bench with facts that its scene leaves out.

    Its `state` of the contact; `young_percent`, the modulus's error, `young_spread`, its standard
    uncertainty in per cent, and `young_pull` (NaN: not fitted); `freed_in_vain`, how many causes
    were named that are not there.
    """

    state: str = ""
    young_percent: float = _NAN
    young_spread: float = _NAN
    young_pull: float = _NAN
    freed_in_vain: int = 0


@dataclass(frozen=True)
class RigRow:
    """One set of images of a beam on a rig: its `facts` by name and the number of `images`; error
    of the fringe value (`percent`), its standard uncertainty (`spread`) and their ratio (`pull`);
    what was `found`, whether every fact is `named`, whether a `false_lens` is; `refused`, why there
    is no value.
    """

    kind: str
    seed: int
    facts: str
    images: int = 0
    percent: float = _NAN
    spread: float = _NAN
    pull: float = _NAN
    named: bool = False
    false_lens: bool = False
    found: str = ""
    chi: float = _NAN
    seconds: float = _NAN
    refused: str = ""


@dataclass(frozen=True)
class InputRow:
    """One frame whose stated inputs are off by chance.

    `kind`, whether they are held or fitted where the frame asks; `load_percent`, error of the load;
    pulls, errors over the combined standard uncertainty; `combined_percent` and `noise_percent`,
    the load's uncertainties; `freed`, whether more was fitted than asked; `chi`; `seconds` of
    processor time; `refused`, why there is no value.
    """

    kind: str
    seed: int
    load_percent: float = _NAN
    load_pull: float = _NAN
    friction_pull: float = _NAN
    combined_percent: float = _NAN
    noise_percent: float = _NAN
    freed: bool = False
    chi: float = _NAN
    seconds: float = _NAN
    refused: str = ""


@dataclass(frozen=True)
class SilentRow:
    """One frame read without a model: `wrong`, share of the specimen called known and off by over
    half a fringe; `kept`, share that is known; `rms` error (fringes) and `pull` of what is on its
    branch; `said`, the warnings.
    """

    kind: str
    light: str
    points: str
    wrong: float = _NAN
    kept: float = _NAN
    rms: float = _NAN
    pull: float = _NAN
    said: str = ""
    seconds: float = _NAN


@dataclass(frozen=True)
class PlanRow:
    """One value of one planned experiment beside what virtual runs of it scatter by.

    `scene`, `key`; `planned`, the standard uncertainty that the plan says, and `scatter`, the root
    mean square of the runs' errors, both relative; `ratio` of the first to the second; how many
    `runs` gave a value, and how many were `refused`; `seconds` of processor time of the plan.
    """

    scene: str
    key: str
    planned: float
    scatter: float
    ratio: float
    runs: int
    refused: int
    seconds: float
