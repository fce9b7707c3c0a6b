"""What a page has inside it: uPlot and its style sheet."""

from functools import cache


@cache
def plotting_script() -> str:
    """uPlot, which the package youplot brings."""
    from youplot.vendor import uplot_js

    return uplot_js()


@cache
def plotting_style() -> str:
    """The style sheet of uPlot."""
    from youplot.vendor import uplot_css

    return uplot_css()
