"""Pictures of maps and arms, and animations (experimental). Nothing here opens a window."""

from cspace.plot._animation import AnimationOptions as AnimationOptions
from cspace.plot._animation import animate
from cspace.plot._arms import draw_arm as draw_arm  # for cspace.arms
from cspace.plot._artists import check_axes as check_axes  # for regions
from cspace.plot._artists import extend_legend as extend_legend  # for reasons and lanes
from cspace.plot._artists import plot_rates as plot_rates  # for planners
from cspace.plot._artists import show_png as show_png  # for all that has a picture
from cspace.plot._picture import PICTURE_SUFFIXES as PICTURE_SUFFIXES  # for the command line
from cspace.plot._picture import PlotOptions as PlotOptions
from cspace.plot._picture import save_figure as save_figure  # for the command line
from cspace.plot._picture import save_plot
from cspace.plot.scene import HasPath as HasPath

__all__ = ["animate", "save_plot"]
