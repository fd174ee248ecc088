"""What a run of `isochrome bench track` shows: the table in plain text, and the figure."""

from isochrome.figures import LINE_COLOURS

from .case_track import WHOLE, WORN, WORN_WHOLE
from .report import lines_of, machine
from .rows import TrackRow

RUN_HEAD = ("film", "workers", "frames", "frames/s", "CPU a frame")
HEAD = (*RUN_HEAD, "reading", "writing", "load error", "pull")
FREE_HEAD = (*RUN_HEAD, "order RMS", "kept", "wrong")
FREE_RATE = 8.0
"""Frames a second of two workers at least without a model."""
RATE, MAPS_RATE, SHARE = 60.0, 25.0, 0.15
"""Frames a second of two workers at least, without and with maps of all frames, and the share of
reading and writing at most."""


def table(rows: list[TrackRow]) -> str:
    """The rows as a table in plain text, with what they mean."""
    free = [(*_run_cells(row), *_order_cells(row)) for row in rows if row.rms == row.rms]
    own = [(*_run_cells(row), *_value_cells(row)) for row in rows if row.rms != row.rms]
    tables = [
        line
        for head, cells in ((HEAD, own), (FREE_HEAD, free))
        if cells
        for line in (*lines_of(head, cells, texts=1), "")
    ]
    return "\n".join([*tables, *_speed_up(rows), *_beside_whole(rows), _FOOT, machine()])


_FOOT = f"""\
frames/s: by the clock, with all that the machine did besides; CPU a frame: processor time of all
processes, start and figure included: two free cores do 2 / (CPU a frame). Reading (counting, hash,
decoding) and writing: shares of the processor time. Load error: relative, root mean square; pull:
error over standard uncertainty. Order RMS and kept: medians over the frames of films without a
model; wrong: share of what is known that is off by over 1/4 fringe, in the worst frame. To be seen:
where frames are tracked, {RATE:g} frames/s on two cores, {MAPS_RATE:g} with all maps; reading and
writing under {100 * SHARE:.0f} % together, a codec's own decoding included; without a model,
{FREE_RATE:g} frames/s."""


def _run_cells(row: TrackRow) -> tuple[str, ...]:
    return (
        row.film,
        str(row.workers),
        str(row.frames),
        f"{row.frames_per_s:.1f}",
        f"{row.cpu_ms:.1f} ms",
    )


def _value_cells(row: TrackRow) -> tuple[str, ...]:
    return (
        _share(row.reading),
        _share(row.writing),
        f"{100 * row.load_error:.4f} %",
        f"{row.pull:.2f}",
    )


def _order_cells(row: TrackRow) -> tuple[str, ...]:
    return f"{row.rms:.4f}", f"{100 * row.kept:.1f} %", f"{100 * row.wrong:.4f} %"


def _share(value: float) -> str:
    return f"{100 * value:.1f} %" if value == value else "-"


def _speed_up(rows: list[TrackRow]) -> list[str]:
    """What the second worker brings, where both were run."""
    by = {(row.film, row.workers): row for row in rows}
    return [
        f"{film}: two workers do {by[film, 2].frames_per_s / row.frames_per_s:.2f} times the frames"
        f" a second of one;\ntwo separate runs at once, all that this machine's cores allow for, "
        f"{by[film, 2].apart_per_s / row.frames_per_s:.2f} times"
        for (film, workers), row in by.items()
        if workers == 1 and (film, 2) in by and row.load_error == row.load_error
    ]


def _beside_whole(rows: list[TrackRow]) -> list[str]:
    """How much faster frames are followed than processed each by itself."""
    rate = {row.film: row.frames_per_s for row in rows}
    if not {WORN, WORN_WHOLE} <= set(rate):
        return []
    return [f"{WORN}: {rate[WORN] / rate[WORN_WHOLE]:.0f} times the frames a second of each wholly"]


def figure(rows: list[TrackRow]):
    """Processor time of a frame by its parts, a bar for each film that one worker tracked."""
    from isochrome.figures import new_figure, style_axes

    alone = [
        row
        for row in rows
        if row.workers == 1 and row.film not in (WHOLE, WORN_WHOLE) and row.reading == row.reading
    ]
    picture = new_figure(9.0, 0.55 * len(alone) + 1.6)
    axes = picture.subplots()
    ends = [0.0] * len(alone)
    parts = (
        ("reading", [row.cpu_ms * row.reading for row in alone]),
        ("writing", [row.cpu_ms * row.writing for row in alone]),
        ("work", [row.cpu_ms * (1.0 - row.reading - row.writing) for row in alone]),
    )
    for (name, widths), colour in zip(parts, LINE_COLOURS[1:], strict=False):
        axes.barh(range(len(alone)), widths, left=ends, color=colour, label=name)
        ends = [end + width for end, width in zip(ends, widths, strict=True)]
    limit = 2e3 / RATE
    axes.axvline(limit, color="black", lw=1.0, ls="--", label=f"{RATE:g} frames/s on two cores")
    axes.set_yticks(range(len(alone)), [row.film for row in alone])
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.1 * max(limit, *ends))
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    style_axes(axes, x_label="processor time of a frame (ms)", title="process --track")
    return picture
