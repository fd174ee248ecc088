"""What ImageJ is told of the TIFFs in a folder, read by tifffile alone."""

import tifffile


def heads_of(folder):
    """Name, ImageJ's head and frames of every TIFF below a folder."""
    found = {}
    for path in sorted(folder.rglob("*.tif")):
        with tifffile.TiffFile(path) as tif:
            found[path.name] = tif.imagej_metadata, len(tif.pages), tif.pages.first.tags
    return found


def has_whole_head(known, frames, tags, *, placed, coloured=False):
    """Whether ImageJ is told labels, and of grey levels range and colours; `placed`, where too."""
    shown = coloured or {"min", "max", "Ranges", "LUTs"} <= known.keys()
    # where ImageJ looks for the colours of one channel; of 8 bits it would make them the values
    shown &= ("ColorMap" in tags) == (not coloured and tags["BitsPerSample"].value > 8)
    across = tags["XResolution"].value
    there = known.get("unit") == "mm" and across[0] > across[1]
    labels = known["Labels"] if isinstance(known["Labels"], list) else [known["Labels"]]
    return (
        shown
        and len(labels) == frames
        and (not placed or (there and {"xorigin", "yorigin"} <= known.keys()))
    )
