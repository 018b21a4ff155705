"""Which triangles of a surface lie upon others of it, by the tree of boxes that they are the leaves of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from windmark.geometry._jit import nb

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@nb.njit(cache=True, nogil=True)
def lie_upon(boxes: Array, highest: Array, leaves: int, per_leaf: int, middle: Array, first: Array, normal: Array,
             weights: Array, height: Array, near: float, alike: float, edge: float, layers: Array, upon: Ints
             ) -> None:  # fmt: skip
    """Layers that each triangle lies upon, half of one over an edge, and the last triangle of those.

    Parameters
    ----------
    boxes : (2 leaves - 1, 6) of a complete binary tree, root first: lowest and highest x, y, z
    highest : (2 leaves - 1,) greatest height of a triangle in each node
    middle, first, normal : (T, 3) middle, first corner and unit normal, ``per_leaf`` in each leaf, in their order
    weights : (T, 3, 2) whose products with a place from the first corner are its weights at the other two
    height : (T,)
    near : part of the larger height within which a middle lies upon a triangle
    alike : cosine of the angle up to which two face the same way
    edge : weight of a corner below which a place is on the edge across from it
    layers, upon : (T,) written; they come as 0 and -1
    """
    stack = np.empty(64, np.int64)
    for a in range(middle.shape[0]):
        x, y, z, tall = middle[a, 0], middle[a, 1], middle[a, 2], height[a]
        stack[0], top = 0, 1
        while top > 0:
            top -= 1
            k = stack[top]
            room = near * max(tall, highest[k])
            if (x < boxes[k, 0] - room or y < boxes[k, 1] - room or z < boxes[k, 2] - room or x > boxes[k, 3] + room
                    or y > boxes[k, 4] + room or z > boxes[k, 5] + room):  # fmt: skip
                continue
            if k < leaves - 1:
                stack[top], stack[top + 1] = 2 * k + 1, 2 * k + 2
                top += 2
                continue
            start = (k - leaves + 1) * per_leaf
            for b in range(start, min(start + per_leaf, middle.shape[0])):
                p, q, r = normal[b, 0], normal[b, 1], normal[b, 2]
                if a == b or normal[a, 0] * p + normal[a, 1] * q + normal[a, 2] * r < alike:
                    continue
                dx, dy, dz = x - first[b, 0], y - first[b, 1], z - first[b, 2]
                if abs(dx * p + dy * q + dz * r) > near * max(tall, height[b]):
                    continue
                u = dx * weights[b, 0, 0] + dy * weights[b, 1, 0] + dz * weights[b, 2, 0]
                v = dx * weights[b, 0, 1] + dy * weights[b, 1, 1] + dz * weights[b, 2, 1]
                least = min(min(u, v), 1 - u - v)
                if least > -edge:
                    layers[a] += 1.0 if least > edge else 0.5
                    upon[a] = max(upon[a], b)
