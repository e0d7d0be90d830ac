# SPDX-License-Identifier: Apache-2.0
"""Largest sizes that are accepted from outside; each is checked before memory is allocated for it."""

from __future__ import annotations

MEGABYTE = 1_000_000

LARGEST_CHUNK = 256 * MEGABYTE
"""Bytes in a chunk of an MCAP file; recorders write 0.8 to 4 million. Thirty kilobytes of zstd can stand for a gigabyte."""
LARGEST_MESSAGE = 64 * MEGABYTE
"""Bytes of one message; a point cloud of 1280 x 960 points with 32 bytes each has 39 million."""
LARGEST_TF_MESSAGE = 4 * MEGABYTE
"""Bytes of one TF message, about 40,000 transforms; a robot's have some thousand bytes."""
LARGEST_STORAGE = 256 * MEGABYTE
"""Bytes of a bag's unpacked storage files; larger ones are unpacked up to `LARGEST_RATIO` times their packed size."""
LARGEST_RATIO = 64
"""Unpacked over packed size of a large storage file; depth images have 3 to 20."""
LARGEST_METADATA = 4 * MEGABYTE
"""Bytes of a bag's metadata.yaml; 200 topics and 1000 files take 0.5 million."""
LARGEST_RASTER = 2**26
"""Pixels of an image or camera, 8192 x 8192; time-of-flight cameras have up to 1.3 million."""
LARGEST_ARRAYS = 512 * MEGABYTE
"""Bytes of all arrays in an .npz file; larger ones are read only where the file is as large on disk."""
MOST_FRAMES = 10_000
"""Frames of a TF tree; a robot has some hundred at most."""
LONGEST_FRAME_NAME = 255
"""Characters of a frame name."""
MOST_NODES = 10_000
"""Nodes of a glTF file, each counted once per parent; trimesh places some 5,000 a second."""
DEEPEST_NODE = 64
"""Levels of a glTF file's nodes; assemblies of CAD have 5 to 20, and trimesh walks them for each node."""
MOST_MESH_ELEMENTS = 20_000_000
"""Vertices and indices of a glTF file, each counted as often as a node shows it; 480 million bytes as float64 triples."""
