import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure


@pytest.fixture
def ax() -> Axes:
    figure = Figure(figsize=(4, 4), dpi=50)
    FigureCanvasAgg(figure)
    return figure.subplots()
