"""Sections of a reconstruction's report page, as HTML."""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sfmcpp.geometry.significance import mad_sigma
from sfmcpp.study.pages.charts import arrows, bars, histogram, match_matrix, match_squares, nice_ticks
from sfmcpp.study.pages.parts import data_uri, png_bytes
from sfmcpp.study.report_table import grouped_by_reason, origin_text, residuals_text

if TYPE_CHECKING:
    from sfmcpp.study.sfm_measures import ModelMeasures
    from sfmcpp.study.sfm_report import SfmReport

_MOST_PICTURES = 200
_MOST_ROWS = 200
# Part of the cells that have a mean, below which a map of residuals says nothing.
_LEAST_TOLD = 0.25
# Images whose pairs are named under the pointer.
_MOST_NAMED = 40
_MOST_CAMERAS, _MOST_MAPS = 50, 4
_LONGEST_TRACK = 20
_MOST_REASONS = 20
# Mean error of an image, over the usual one, from which it is worth a look.
_FAR_ABOVE = 1.5
# Kinds of two-view geometry in words.
_KINDS = {
    "general": "match (general motion)",
    "planar": "match (plane only)",
    "rotation": "match (rotation only)",
    "none": "no match",
}


def section(anchor: str, title: str, content: str) -> list[str]:
    """Make a section of a page; none without content."""
    return [f'<section id="{anchor}"><h2>{title}</h2>\n{content}</section>'] if content else []


def errors(report: SfmReport) -> str:
    """Mean error per image, and histograms of errors and of track lengths."""
    if not report.measures or not report.measures[0].num_observations:
        return ""
    measures = report.measures[0]
    chosen = np.flatnonzero(measures.observations_of_images)
    means, counts = measures.errors_of_images_px[chosen], measures.observations_of_images[chosen]
    names = [measures.world.image_names[i] for i in chosen]
    titles = [f"{n}: {e:.3f} px, {c:,} observations" for n, e, c in zip(names, means, counts, strict=True)]
    spread = mad_sigma(means - np.median(means))
    usual = float(np.median(means))
    marked = (means > max(usual + 4 * spread, _FAR_ABOVE * usual)).tolist()
    worst = ", ".join(html.escape(name) for name, is_marked in zip(names, marked, strict=True) if is_marked)
    note = f'<p class="soft">Far above the other images: {worst}</p>' if 0 < sum(marked) <= 8 else ""
    words = "image, sorted by name"
    of_images = bars(means.tolist(), titles, x_label=words, y_label="mean error [px]", marked=marked)
    end = nice_ticks(float(np.quantile(measures.errors_px, 0.995)))[-1]
    of_errors = histogram(
        measures.errors_px, np.linspace(0, end, 41), x_label="error [px]", y_label="observations"
    )
    return (
        '<div class="pair">'
        + _figure("Mean reprojection error of each image", of_images + note)
        + _figure("Reprojection errors of all observations", of_errors)
        + _figure("Track lengths: number of images that see a point", _tracks(measures))
        + "</div>"
    )


def _tracks(measures: ModelMeasures) -> str:
    lengths = measures.track_lengths
    longest = int(min(lengths.max(), _LONGEST_TRACK))
    counts = np.bincount(np.minimum(lengths, longest), minlength=longest + 1)[2:]
    words = [str(n) for n in range(2, longest + 1)]
    if lengths.max() > longest:
        words[-1] += "+"
    titles = [f"{word} images: {count:,} points" for word, count in zip(words, counts.tolist(), strict=True)]
    labels = [(place + 0.5, word) for place, word in enumerate(words)]
    return bars(counts.tolist(), titles, x_label="images", y_label="points", tick_labels=labels)


def cameras(report: SfmReport) -> str:
    """Intrinsics, and a map of the residuals of each camera."""
    if not report.measures or not report.measures[0].cameras:
        return ""
    measures = report.measures[0]
    shown = measures.cameras[:_MOST_CAMERAS]
    rows = [_camera_row(measures.camera_dict(camera)) for camera in shown]
    head = ("camera", "images", "size", "model", "focal length [px]", "principal point [px]", "distortion")
    more = len(measures.cameras) - len(shown)
    rest = f'<p class="soft">And {more:,} more; report.json lists all.</p>' if more else ""
    listed = f'<div class="tall">{_table(head, rows)}</div>'
    return listed + rest + _residual_maps(measures)


def _camera_row(facts: dict[str, Any]) -> list[str]:
    sigma = facts["sigma"]

    def with_sigma(name: str, value: str) -> str:
        return f"{value} ± {sigma[name]:.2g}" if name in sigma else value

    x, y = facts["principal_point_px"]
    aspect = "" if facts["aspect"] == 1 else f", aspect {facts['aspect']:.6g}"
    distortion = [f"{name} {with_sigma(name, f'{value:.5g}')}" for name, value in facts["distortion"].items()]
    return [
        str(facts["id"]),
        f"{facts['images']:,}",
        f"{facts['width']} × {facts['height']}" if facts["width"] else "unknown",
        facts["model"],
        with_sigma("f", f"{facts['focal_px']:.2f}") + aspect,
        f"{with_sigma('cx', f'{x:.1f}')}, {with_sigma('cy', f'{y:.1f}')}",
        ", ".join(distortion) or "none",
    ]


def _residual_maps(measures: ModelMeasures) -> str:
    numbers = measures.cameras
    chosen: list[tuple[str, list[int]]] = [(f"camera {measures.world.camera_ids[n]}", [n]) for n in numbers]
    if len(numbers) > _MOST_MAPS:
        size = measures.world.camera_sizes[numbers[0]]
        alike = [n for n in numbers if (measures.world.camera_sizes[n] == size).all()]
        chosen = [(f"all {len(alike):,} cameras of {size[0]} × {size[1]} together", alike), *chosen]
    parts = []
    for name, group in chosen[:_MOST_MAPS]:
        found = measures.residual_map(group)
        if found is not None and np.mean(np.isfinite(found.means)) > _LEAST_TOLD:
            picture, scale = arrows(found)
            words = f"Mean residuals of {name}; an arrow of one cell length is {scale:g} px"
            parts.append(_figure(words, picture))
    if not parts:
        return ""
    note = (
        "Observed minus projected, averaged over cells; darker blue means more observations. "
        "A regular pattern of arrows indicates distortion that the camera model does not describe."
    )
    return f'<div class="pair">{"".join(parts)}</div><p class="soft">{note}</p>'


def gps(report: SfmReport) -> str:
    """How far the images lie from their GPS positions."""
    found = report.run.gps
    if found is None:
        return ""
    outliers = set(found.outliers)
    names = list(found.residuals_m)
    values = [found.residuals_m[name] for name in names]
    titles = [f"{name}: {value:.3g} m" for name, value in zip(names, values, strict=True)]
    chart = bars(
        values, titles, x_label="image", y_label="distance [m]", marked=[name in outliers for name in names]
    )
    first, second, height = np.asarray(found.origin).tolist()
    frame = f"those of the positions, with the origin at {origin_text(found.world_origin)}"
    if found.geodetic:
        frame = f"east, north, up, with the origin at {first:.7f}°, {second:.7f}°, {height:.2f} m (WGS84)"
    facts = [
        f"Estimated σ of the GPS positions: {found.sigma_m:.3g} m per coordinate. Georeferencing accuracy of "
        f"the model: {found.accuracy_m:.3g} m (1 σ).",
        f"Axes: {frame}.",
    ]
    if found.rms_m is not None:
        facts.insert(1, f"Residuals: {residuals_text(found)}.")
    paragraphs = "".join(f"<p>{fact}</p>" for fact in facts)
    excluded = [
        [html.escape(name), f"{found.residuals_m[name]:.2f}" if name in found.residuals_m else "–"]
        for name in found.outliers
    ]
    listed = "<h3>Excluded positions</h3>" + _table(("image", "distance [m]"), excluded) if excluded else ""
    return paragraphs + _figure("Distance of each image from its GPS position", chart) + listed


def matches(report: SfmReport) -> str:
    """Which image matches which, and why pairs were left out."""
    pairs, photos = report.run.graph.pairs, report.run.graph.photos
    if not pairs:
        return ""
    first, second = np.array([(p.first, p.second) for p in pairs], dtype=np.intp).T
    agreed = [np.count_nonzero(p.geometry.inliers) * (p.geometry.kind != "none") for p in pairs]
    inliers = np.array(agreed, dtype=np.intp)
    words = (
        "Rows and columns are the images, sorted by name. A stronger colour means more verified matches; "
        "grey pairs were tried without success."
    )
    if len(photos) <= _MOST_NAMED:
        picture = match_squares([photo.name for photo in photos], first, second, inliers)
    else:
        pixels = match_matrix(len(photos), first, second, inliers)
        uri = data_uri("image/png", png_bytes(pixels))
        picture = f'<img class="matrix" src="{uri}" alt="matrix of matching images">'
    matrix = f'{picture}<p class="soft">{words}</p>'
    kinds = Counter(pair.geometry.kind for pair in pairs)
    listed = [[_KINDS[kind], f"{kinds[kind]:,}"] for kind in _KINDS if kinds[kind]]
    counts = _table(("pairs", "count"), listed)
    return f'<div class="pair"><div>{matrix}</div><div>{counts}</div></div>{_left_out(report)}'


def _left_out(report: SfmReport) -> str:
    """Pairs that are not "general", by their reason and one by one; those with most matches first."""
    poor = [pair for pair in report.run.graph.pairs if pair.geometry.kind != "general"]
    if not poor:
        return ""
    reasons = grouped_by_reason((pair.geometry.message, pair) for pair in poor)
    summed = [
        [html.escape(reason), f"{len(found):,}"] for reason, found in list(reasons.items())[:_MOST_REASONS]
    ]
    poor.sort(key=lambda pair: (-len(pair.matches), pair.first, pair.second))
    rows = []
    for facts in map(report.pair, poor[:_MOST_ROWS]):
        counts = [f"{facts[name]:,}" for name in ("matches", "inliers")]
        names = [html.escape(facts[name]) for name in ("first", "second")]
        rows.append([*names, *counts, facts["kind"], html.escape(facts["reason"])])
    cut = f"the {_MOST_ROWS} pairs with most matches of " if len(poor) > _MOST_ROWS else ""
    head = ("first", "second", "matches", "inliers", "kind", "reason")
    return (
        "<h3>Pairs with limited or no use</h3>"
        + _table(("reason", "pairs"), summed)
        + f"<details><summary>List {cut}{len(poor):,} pairs</summary>"
        + f'<div class="tall">{_table(head, rows)}</div></details>'
    )


def images(report: SfmReport, thumbnails: Mapping[str, bytes]) -> str:
    """All images with their figures; those left out come first."""
    facts = report.images()
    names = sorted(facts, key=lambda name: facts[name]["registered"])
    with_gps = any("gps_residual_m" in entry for entry in facts.values())
    rows = []
    for place, name in enumerate(names):
        picture = thumbnails.get(name) if place < _MOST_PICTURES else None
        rows.append(_image_row(name, facts[name], picture, with_gps))
    numbers = ["keypoints", "observations", "mean error [px]", *["GPS [m]"] * with_gps]
    head = [("", ""), ("image", "word"), *((name, "number") for name in numbers)]
    head += [("model", "word"), ("reason", "word")]
    heads = "".join(f'<th data-sort="{kind}">{name}</th>' if kind else "<th></th>" for name, kind in head)
    note = f"Only the first {_MOST_PICTURES} images have a picture. " if len(names) > _MOST_PICTURES else ""
    return (
        f'<p class="soft">{note}Click a heading to sort.</p><div class="scroll tall"><table>'
        f"<thead><tr>{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>"
    )


def _image_row(name: str, facts: dict[str, Any], picture: bytes | None, with_gps: bool) -> str:
    shown = f'<img src="{data_uri("image/jpeg", picture)}" alt="">' if picture else ""
    cells = [f"<td>{shown}</td>", f'<td class="name">{html.escape(name)}</td>']
    numbers = [(facts["keypoints"], ",d"), (facts["observations"], ",d"), (facts["mean_error_px"], ".3f")]
    if with_gps:
        numbers.append((facts.get("gps_residual_m"), ".2f"))
    for value, form in numbers:
        missing = value is None or not np.isfinite(value)
        text = "–" if missing else format(value, form)
        cells.append(f'<td class="number" data-value="{-1 if missing else value}">{text}</td>')
    model = f"model {facts['model']}" if facts["model"] else "largest"
    cells.append(f"<td>{model}</td>" if facts["registered"] else '<td class="bad">left out</td>')
    cells.append(f'<td class="why">{html.escape(facts["reason"])}</td>')
    return f"<tr>{''.join(cells)}</tr>"


def settings_section(report: SfmReport) -> str:
    """Input and options."""
    rows = {"input": report.run.source, **report.options()}
    entries = [(html.escape(str(k)), html.escape(str(v))) for k, v in rows.items() if v is not None]
    listed = "".join(f"<dt>{name}</dt><dd>{value}</dd>" for name, value in entries)
    note = "report.json has all of this in machine-readable form; timings.json has the run times."
    return f'<dl>{listed}</dl><p class="soft">{note}</p>'


def _figure(caption: str, content: str) -> str:
    return f"<figure><figcaption>{caption}</figcaption>{content}</figure>"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Make a table of cells that are HTML already."""
    heads = "".join(f"<th>{name}</th>" for name in head)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table></div>'
