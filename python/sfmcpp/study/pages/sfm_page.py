"""Report page of a reconstruction: results, and the reasons for missing images."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from sfmcpp.study.pages.charts import top_view
from sfmcpp.study.pages.parts import data_uri, filled, png_bytes
from sfmcpp.study.pages.sfm_sections import cameras, errors, gps, images, matches, section, settings_section
from sfmcpp.study.pages.viewpoint import turn_upright
from sfmcpp.study.report_files import VIEW

if TYPE_CHECKING:
    from sfmcpp.study.sfm_report import SfmReport

_MOST_LEFT_OUT_ON_TOP = 6


def sfm_page(report: SfmReport, thumbnails: Mapping[str, bytes] | None = None) -> str:
    """Make the page: one HTML text with everything in it, the same for the same run.

    Parameters
    ----------
    report : SfmReport
        What came out.
    thumbnails : mapping of str to bytes, optional
        Small pictures of photos as JPEG, by name.

    Returns
    -------
    str
        HTML with its style, script and pictures; no times stand in it.
    """
    title = f"Reconstruction of {report.title}"
    body = [_head(report, title)]
    body += section("errors", "Reprojection errors", errors(report))
    body += section("cameras", "Cameras", cameras(report))
    body += section("gps", "GPS", gps(report))
    body += section("matches", "Matching pairs", matches(report))
    body += section("images", "Images", images(report, thumbnails or {}))
    body += section("how", "Input and options", settings_section(report))
    return filled("sfm_page.html", title=html.escape(title), body="\n".join(body))


def _head(report: SfmReport, title: str) -> str:
    run = report.run
    complete = run.num_registered == len(run.images) > 0
    parts = [f"<h1>{html.escape(title)}</h1>", _verdict(report, complete)]
    if run.interrupted:
        parts.append('<p class="warning">Interrupted: these are the results up to that point.</p>')
    parts += [f'<p class="warning">{html.escape(warning)}</p>' for warning in run.warnings]
    tiles = "".join(
        f'<div class="tile"><b>{html.escape(value)}</b><span>{html.escape(name)}</span></div>'
        for name, value in _summary_tiles(report)
    )
    parts.append(f'<div class="top"><div class="tiles">{tiles}</div>{_top_view(report)}</div>')
    return "\n".join(parts)


def _verdict(report: SfmReport, complete: bool) -> str:
    run = report.run
    if run.model is None:
        sentence = f"No model: none of {len(run.images):,} images could be registered."
    elif complete:
        sentence = f"All {len(run.images):,} images are in one model."
    else:
        sentence = f"{run.num_registered:,} of {len(run.images):,} images are in the model."
    kind = "good" if complete else "bad"
    parts = [f'<p class="verdict {kind}">{sentence}</p>']
    reasons = list(report.left_out().items())
    for reason, names in reasons[:_MOST_LEFT_OUT_ON_TOP]:
        count = names[0] if len(names) == 1 else f"{len(names):,} images"
        parts.append(f"<p>{html.escape(count)}: {html.escape(reason)}</p>")
    if len(reasons) > _MOST_LEFT_OUT_ON_TOP:
        parts.append('<p><a href="#images">more reasons</a></p>')
    return "".join(parts)


def _summary_tiles(report: SfmReport) -> Iterator[tuple[str, str]]:
    run = report.run
    yield "images registered", f"{run.num_registered:,} / {len(run.images):,}"
    if report.measures:
        largest = report.measures[0]
        yield "points", f"{largest.num_points:,}"
        if largest.mean_error_px is not None:
            yield "mean error of observations", f"{largest.mean_error_px:.3f} px"
            yield "mean error of points (COLMAP's mean)", f"{largest.mean_point_error_px:.3f} px"
            yield "RMS error (length)", f"{largest.rms_px:.3f} px"
            yield "mean track length", f"{largest.track_lengths.mean():.2f}"
        if largest.cameras:
            yield "focal length", f"{largest.intrinsics_of(largest.cameras[0])['f']:,.1f} px"
    if run.gps is not None:
        yield "georeferencing accuracy (1 σ)", f"{run.gps.accuracy_m:.3g} m"
        yield "GPS positions left out", f"{len(run.gps.outliers):,}"
    if len(run.models) > 1:
        yield "models", f"{len(run.models):,}"
    matched = sum(pair.geometry.kind != "none" for pair in run.graph.pairs)
    yield "matching pairs", f"{matched:,} / {len(run.graph.pairs):,}"


def _top_view(report: SfmReport) -> str:
    """Picture of the model from above, which leads to its page."""
    world = report.run.model
    if world is None:
        return ""
    poses = world.poses[world.registered]
    is_placed = report.run.gps is not None
    turn = np.eye(3) if is_placed else turn_upright(poses)
    colors = world.point_colors[world.known]
    if not colors.any():
        colors = np.full_like(colors, 128)
    picture = top_view(world.points[world.known] @ turn.T, colors, poses[:, :, 3] @ turn.T)
    image = f'<img src="{data_uri("image/png", png_bytes(picture))}" alt="top view of the model">'
    guessed = "" if is_placed else " (up as the cameras suggest)"
    words = f"top view{guessed}, cameras in orange; click for the 3-D view"
    return f'<a class="plan" href="{VIEW}">{image}<span>{words}</span></a>'
