"""Pictures of maps and arms, and animations (experimental). Nothing here opens a window."""

from cspace.plot._animation import AnimationOptions as AnimationOptions
from cspace.plot._animation import animate
from cspace.plot._arms import draw_arm as draw_arm  # for cspace.arms
from cspace.plot._artists import extend_legend
from cspace.plot._artists import plot_rates as plot_rates  # for planners
from cspace.plot._picture import PICTURE_SUFFIXES, plot, save_figure, save_plot
from cspace.plot._picture import PlotOptions as PlotOptions
from cspace.plot._route import HasPath as HasPath

__all__ = ["PICTURE_SUFFIXES", "animate", "extend_legend", "plot", "save_figure", "save_plot"]
