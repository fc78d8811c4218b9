"""Logarithmic plots, several to a page, as SVG."""

import math


def decades(values):
    """The powers of ten around positive values."""
    low, high = math.floor(math.log10(min(values))), math.ceil(math.log10(max(values)))
    return low, max(high, low + 1)


def panel(left, top, wide, high, title, lines):
    """A log-log plot; `lines` are (colour, marked, [(x, y)])."""
    x_low, x_high = decades([x for *_, points in lines for x, _ in points])
    y_low, y_high = decades([y for *_, points in lines for _, y in points])
    inner = (left + 44, top + 22, wide - 58, high - 52)
    parts = [
        f'<text x="{inner[0]}" y="{top + 14}">{title}</text>',
        '<rect x="{}" y="{}" width="{}" height="{}" fill="none" stroke="#999"/>'.format(*inner),
    ]

    def place(x, y):
        along = (math.log10(x) - x_low) / (x_high - x_low)
        up = (math.log10(y) - y_low) / (y_high - y_low)
        return inner[0] + along * inner[2], inner[1] + (1 - up) * inner[3]

    for power in range(x_low, x_high + 1):
        x, y = place(10.0**power, 10.0**y_low)
        parts.append(f'<text x="{x:.0f}" y="{y + 14:.0f}" text-anchor="middle">{10.0**power:g}</text>')
    for power in range(y_low, y_high + 1):
        x, y = place(10.0**x_low, 10.0**power)
        parts.append(f'<text x="{x - 4:.0f}" y="{y + 3:.0f}" text-anchor="end">{10.0**power:g}</text>')
    for colour, marked, points in lines:
        places = [place(*point) for point in points]
        if marked:
            parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{colour}"/>' for x, y in places]
        if len(places) > 1:
            path = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
            parts.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="1.5"/>')
    return parts


def page(wide, high, heading, parts):
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide}" height="{high}" font-family="sans-serif" '
        f'font-size="10"><rect width="100%" height="100%" fill="white"/><text x="8" y="14">{heading}</text>'
    )
    return "\n".join([head, *parts, "</svg>"]) + "\n"
