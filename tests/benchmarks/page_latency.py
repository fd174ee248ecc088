"""From a slider of the set-up page to the model's picture, in a real Chromium.

Run it as a script, on a machine that does nothing else: `python tests/benchmarks/page_latency.py`.
Each step moves a slider by a little and waits until the new picture of 659 x 494 pixels is drawn,
as a user sees it: the request, the model, the way back, the colours and the frame of the screen.
"""

import shutil
import sys
import tempfile
import threading
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from browsers import open_chromium
from isochrome.samples import samples_path
from isochrome.setup_page import SetupServer, open_session

SLIDERS = (
    "load.normal_n", "friction.coefficient", "specimen.fringe_value_n_per_mm", "camera.left_mm",
    "camera.top_mm", "camera.roll_deg",
)  # fmt: skip
STEPS = 40
FRAMES = {1: "sliding", 3: "worn"}

MEASURE = """
async ([id, steps]) => {
  const bar = document.getElementById(id), canvas = document.getElementById('canvas');
  const low = Number(bar.min), high = Number(bar.max), times = [];
  for (let k = 0; k < steps; k++) {
    const old = canvas.dataset.model, began = performance.now();
    bar.value = low + (high - low) * (0.3 + 0.4 * ((k * 7) % steps) / steps);
    bar.dispatchEvent(new Event('input'));
    while (canvas.dataset.model === old) await new Promise(requestAnimationFrame);
    times.push(performance.now() - began);
  }
  return times;
}
"""


def main() -> None:
    """Print the median and the 90 per cent of every slider, in two states of the sample."""
    with tempfile.TemporaryDirectory() as folder:
        sample = samples_path() / "line-contact-wear"
        for name in ("captured.tif", "scene.toml", "no-load-dark.tif", "no-load-bright.tif"):
            shutil.copy(sample / name, folder)
        server = SetupServer(open_session(Path(folder) / "captured.tif"))
        thread = threading.Thread(target=server.run)
        thread.start()
        with open_chromium() as browser:
            page = browser.new_page(viewport={"width": 1280, "height": 800})
            page.goto(server.url)
            page.wait_for_function("() => document.getElementById('canvas').dataset.model")
            page.wait_for_timeout(8000)  # the check that comes by itself
            every = []
            for frame, state in FRAMES.items():
                page.fill("#frame-number", str(frame))
                page.press("#frame-number", "Tab")
                page.wait_for_timeout(1500)
                for key in SLIDERS:
                    times = page.evaluate(MEASURE, [f"slide-{key}", STEPS])
                    every += times
                    say(f"{state}, {key}", times)
            say("all", every)
        thread.join()


def say(what: str, times: list[float]) -> None:
    """Print a line."""
    median, slow = np.percentile(times, [50, 90])
    print(f"{what:<48} median {median:6.1f} ms   90 % {slow:6.1f} ms", flush=True)


if __name__ == "__main__":
    main()
