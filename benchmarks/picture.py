# SPDX-License-Identifier: Apache-2.0
"""Image registration in 2D as a baseline: features with a homography, and ECC; and the difference of two images."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Float, Mask


def by_features(first: Bytes, now: Bytes) -> Float | None:
    """Homography (3, 3) that maps pixels of `now` (h, w, 3) to those of `first`, by SIFT and RANSAC; None if not found."""
    import cv2

    detector = cv2.SIFT.create(3000)
    (k1, d1), (k2, d2) = (detector.detectAndCompute(_grey(image), None) for image in (first, now))
    if d1 is None or d2 is None or min(len(k1), len(k2)) < 8:
        return None
    pairs = [p for p in cv2.BFMatcher().knnMatch(d2, d1, k=2) if len(p) == 2]
    good = [a for a, b in pairs if a.distance < 0.75 * b.distance]
    if len(good) < 8:
        return None
    source, target = np.array([k2[m.queryIdx].pt for m in good]), np.array([k1[m.trainIdx].pt for m in good])
    H, kept = cv2.findHomography(source, target, cv2.RANSAC, 3.0)
    return None if H is None or int(kept.sum()) < 8 else np.asarray(H, float)


def by_ecc(first: Bytes, now: Bytes, start: Float | None = None, rounds: int = 60) -> Float | None:
    """The same by maximising the enhanced correlation (Evangelidis and Psarakis 2008), from `start`; None if it diverges."""
    import cv2

    warp = np.linalg.inv(np.eye(3) if start is None else start).astype(np.float32)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, rounds, 1e-5)
    try:
        _, warp = cv2.findTransformECC(_grey(first), _grey(now), warp / warp[2, 2], cv2.MOTION_HOMOGRAPHY, stop, None, 5)
    except cv2.error:
        return None
    return np.linalg.inv(np.asarray(warp, float))


def warped(now: Bytes, H: Float) -> tuple[Bytes, Mask]:
    """`now` warped onto `first`, and the mask of its pixels."""
    import cv2

    size = now.shape[1], now.shape[0]
    inside = cv2.warpPerspective(np.full(now.shape[:2], 255, np.uint8), H, size)
    return np.asarray(cv2.warpPerspective(now, H, size)), np.asarray(inside == 255)


def difference(first: Bytes, now: Bytes, where: Mask | None = None) -> float:
    """Mean absolute difference of the grey images, of 255, after a robust fit of gain and offset of the brightness."""
    a, b = _grey(first).astype(float), _grey(now).astype(float)
    inside = np.ones(a.shape, bool) if where is None else where
    if inside.sum() < 100:
        return float("nan")
    gain, offset = _light(a[inside], b[inside])
    return float(np.abs(a[inside] - gain * b[inside] - offset).mean())


def structure(image: Bytes) -> Float:
    """(h, w) structure of an image without its lighting: log brightness minus its mean over 8 pixels.

    A moving lamp multiplies brightness by a factor that is smooth in the image except at the edges of cast shadows. A displaced
    edge (the pseudo defect of the paper's figure 11) remains visible (homomorphic filtering, Oppenheim et al. 1968).
    """
    import cv2

    log = np.log(cv2.GaussianBlur(_grey(image).astype(float), (0, 0), 0.8) + 4.0)
    return np.asarray(log - cv2.GaussianBlur(log, (0, 0), 8.0))


def structural_difference(first: Bytes, now: Bytes, where: Mask) -> float:
    """Mean absolute difference of `structure`, in percent of brightness, over pixels `where` (h, w)."""
    return 100.0 * float(np.abs(structure(first) - structure(now))[where].mean()) if where.any() else float("nan")


def _light(a: Float, b: Float) -> tuple[float, float]:
    """Gain and offset that bring b to a, by iteratively reweighted least squares."""
    weight = np.ones(len(a))
    gain, offset = 1.0, 0.0
    for _ in range(8):
        X = np.stack([b, np.ones(len(b))], axis=1) * weight[:, None]
        gain, offset = np.linalg.lstsq(X.T @ (X / np.maximum(weight[:, None], 1e-9)) + 1e-6 * np.eye(2), X.T @ a, rcond=None)[0]
        weight = 1.0 / np.maximum(np.abs(a - gain * b - offset), 2.0)
    return float(gain), float(offset)


def _grey(image: Bytes) -> Bytes:
    import cv2

    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
