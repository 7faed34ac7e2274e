"""The figures and tables of the three papers, and the results of this project that compare with them.

`experiments.paper_tables.page` writes the page.
"""

from dataclasses import dataclass

from experiments._harness.results import Table


@dataclass(frozen=True)
class Quote:
    """Cells of one row of a table.

    Attributes:
        text: text with one `{}` for each cell.
        table: title of the table, as in `Results.tables`.
        row: the first cells of the row.
        columns: names of the columns of the cells.
    """

    text: str
    table: str
    row: tuple[str, ...]
    columns: tuple[str, ...]

    def read(self, tables: dict[str, Table]) -> str:
        """Return the text with its numbers.

        Raises:
            KeyError: the results lack the table, the row or the column.
        """
        row = tables[self.table].row(self.row)
        return self.text.format(*(row[column] for column in self.columns))


@dataclass(frozen=True)
class Gain:
    """Relative difference between the means of two columns, in percent.

    Attributes:
        text: text with one `{}` for the percentage.
        table: title of the table, as in `Results.tables`.
        over: name of the column in the numerator.
        under: name of the column in the denominator.
    """

    text: str
    table: str
    over: str
    under: str

    def read(self, tables: dict[str, Table]) -> str:
        """Return the text with its number.

        Raises:
            KeyError: the results lack the table or the column.
        """
        rows = [tables[self.table].row(row[:1]) for row in tables[self.table].rows]
        over, under = (sum(float(row[column]) for row in rows) for column in (self.over, self.under))
        return self.text.format(f"{100 * (over / under - 1):+.2f} %")


@dataclass(frozen=True)
class Item:
    """A table, a figure or a number of a paper.

    Attributes:
        name: its name in the paper.
        shows: its content, with the numbers of the paper.
        ours: the numbers of the experiment that compare with it.
        files: the files of the results that show it.
    """

    name: str
    shows: str
    ours: tuple[Quote | Gain, ...]
    files: tuple[str, ...] = ("table.md",)


@dataclass(frozen=True)
class Paper:
    """A paper.

    Attributes:
        name: authors and year, as in the bibliography.
        title: its topic.
        experiment: name of the experiment that tests its claims.
        note: a note on its numbers.
        items: its figures, tables and numbers.
    """

    name: str
    title: str
    experiment: str
    note: str
    items: tuple[Item, ...]


_POSE = ("position RMSE, m", "heading RMSE, °")
_CLOUD = ("particles around the truth, m", "spread, m")


def _hall(world: str, size: str) -> tuple[Item, ...]:
    """Return the items of a hall: maps, errors over time, and particles."""
    compared, equal = f"{world}: Methods", f"{world}: At an equal number of evaluations"
    methods = {
        "15 particles, improved": ("improved", "15"),
        "30 particles, traditional": ("traditional RBPF", "30"),
        "30 particles, scan matching as in gmapping": ("scan matching as gmapping", "30"),
    }
    two = {name: methods[name] for name in ("15 particles, improved", "30 particles, traditional")}
    equals = {
        "6 particles, improved, as one swarm": ("improved, the particles as one swarm", "6"),
        "510 particles, traditional": ("traditional RBPF", "510"),
    }
    return (
        Item(
            f"Figures 4 and 5, hall of {size}",
            "Maps by the improved filter with 15 particles (figure 4) and by the traditional filter with 30 "
            "(figure 5). No numbers",
            tuple(
                Quote(f"{name}: IoU of walls {{}}", compared, row, ("IoU of walls (worst)",))
                for name, row in two.items()
            ),
            (f"{world}-maps.png",),
        ),
        Item(
            f"Figure 6, hall of {size}",
            "Error in position and heading over 200 s. Curves without numbers",
            tuple(Quote(f"{name}: {{}} m, {{}}°", compared, row, _POSE) for name, row in methods.items())
            + tuple(
                Quote(f"at 510 evaluations per scan, {name}: {{}} m, {{}}°", equal, row, _POSE)
                for name, row in equals.items()
            ),
            (f"{world}-errors.png",),
        ),
        Item(
            f"Figure 7, hall of {size}",
            "Particles around the true pose after filtering. No numbers",
            tuple(
                Quote(
                    f"{name}: RMS distance to the truth {{}} m, to the mean {{}} m",
                    compared,
                    row,
                    _CLOUD,
                )
                for name, row in methods.items()
            ),
            (f"{world}-clouds.png",),
        ),
    )


LIANG = Paper(
    "Liang et al.",
    "an improved filter with EKF fusion, ICP and fruit-fly optimization",
    "tobacco_line",
    "The paper states that 15 particles of the improved filter are as accurate as 30 of the traditional one. "
    "It prints curves and maps without numbers, so the size of the differences cannot be compared.",
    _hall("hall_small", "18 × 15 m") + _hall("hall_large", "24 × 23 m"),
)


def _distortion(name: str, row: tuple[str, ...]) -> Quote:
    columns = ("position RMSE, m", "length error, m", "width error, m")
    return Quote(f"{name}: position {{}} m, length {{}} m, width {{}} m", "Mapping", row, columns)


def _found(name: str, task: str, which: str) -> Quote:
    text = f"{name}, {which} map: {{}} found; updates until found (median, worst) {{}}"
    columns = ("found at the end", "updates until found: median, worst")
    return Quote(text, "Localisation", (task, which), columns)


def _tracked(which: str) -> Quote:
    columns = ("error when tracked, m",)
    return Quote(f"tracking, {which} map: {{}} m", "Localisation", ("tracking", which), columns)


# Spelled as in the stored results.
_TRADITIONAL, _OPTIMIZED = "traditional FastSLAM", "optimised FastSLAM"

YANG = Paper(
    "Yang et al. 2019",
    "AMCL and an optimized FastSLAM in a coal-mine roadway",
    "coal_mine",
    "The paper makes three claims without numbers: the traditional filter distorts the map of a roadway, the "
    "optimized filter does not, even with fewer particles, and AMCL localizes the robot there.",
    (
        Item(
            "Figures 7 and 8",
            "The map of the roadway: distorted by the traditional FastSLAM, straight by the optimized one",
            tuple(
                Quote(f"{name}: IoU of walls {{}}", "Mapping", row, ("IoU of walls (worst)",))
                for name, row in (
                    ("30 particles, traditional", (_TRADITIONAL, "30")),
                    ("15 particles, optimized", (_OPTIMIZED, "15")),
                )
            ),
            ("maps.png",),
        ),
        Item(
            "Distortion over numbers of particles",
            "The optimized filter needs fewer particles for a map without distortion",
            tuple(
                _distortion(f"{count} particles, {name}", (method, count))
                for name, method, counts in (
                    ("traditional", _TRADITIONAL, ("15", "30", "100", "300")),
                    ("optimized", _OPTIMIZED, ("5", "15", "30")),
                )
                for count in counts
            ),
            ("table.md", "particles.png"),
        ),
        Item(
            "AMCL (8–15)",
            "A robot localizes itself in the known map of the roadway",
            (
                _tracked("true"),
                _tracked("built"),
                _found("global start", "global", "true"),
                _found("global start", "global", "built"),
                _found("kidnapped", "kidnapped", "true"),
                _found("kidnapped", "kidnapped", "built"),
            ),
            ("table.md", "localisation.png"),
        ),
    ),
)

_LOOPS = "Table II, the worst device of the data sheet"
_FIGURES = "The same in figures"
TABLE_II = {
    "30": ("0/10", "53", "10/10", "58"),
    "100": ("4/10", "47.9", "10/10", "58.3"),
    "200": ("6/10", "48.5", "10/10", "61.6"),
    "400": ("10/10", "46.9", "10/10", "67.8"),
}
"""Table II of Jamaludin et al., by particles: loops closed and inliers, without and with the network."""


def _loops(count: str) -> Item:
    without, inliers_without, closed, inliers = TABLE_II[count]
    return Item(
        f"Table II, {count} particles",
        f"Without the network {without} loops closed, {inliers_without} inliers; with it {closed}, {inliers}",
        (
            Quote(
                "without: {} closed, {} inliers ({} on the map from known poses)",
                _LOOPS,
                (count,),
                ("closed without", "inliers without", "inliers of known poses without"),
            ),
            Quote(
                "with: {} closed, {} inliers ({} on the map from known poses)",
                _LOOPS,
                (count,),
                ("with", "with (2)", "with (3)"),
            ),
        ),
    )


def _with_and_without(text: str, *columns: str) -> tuple[Quote, ...]:
    return tuple(
        Quote(f"{net} the network, {count} particles: {text}", _FIGURES, (net, count), columns)
        for net in ("without", "with")
        for count in TABLE_II
    )


JAMALUDIN = Paper(
    "Jamaludin et al.",
    "a neural network corrects the ranges of a cheap lidar",
    "range_network",
    "The paper uses a real TurtleBot3. This project simulates a corridor of the same size, and a lidar with "
    "the largest errors that its data sheet allows. The number of inliers depends on the features and on the "
    "reference map, so compare differences, not absolute numbers.",
    (
        Item(
            "Training",
            "50 tanh neurons, trained by Levenberg–Marquardt: MSE 9.55e-5 m² at the training distances",
            (
                Quote(
                    "MSE {} m² at training distances; RMSE at held-out distances {} mm, uncorrected {} mm",
                    "Training",
                    ("levenberg-marquardt",),
                    ("MSE at learnt distances, m²", "RMSE at held-out, mm", "raw there, mm"),
                ),
                Quote(
                    "by Adam: MSE {} m²; RMSE at held-out distances {} mm",
                    "Training",
                    ("adam",),
                    ("MSE at learnt distances, m²", "RMSE at held-out, mm"),
                ),
            ),
            ("table.md", "training/training.png", "training/training.json"),
        ),
        Item(
            "Figures 8 to 13",
            "Readings over true distance, their errors, histograms at 1 m and 3 m, and standard deviations "
            "over distance. Curves without numbers",
            (
                Quote(
                    "RMSE at held-out distances: uncorrected {} mm, corrected {} mm, noise alone {} mm",
                    "Training",
                    ("levenberg-marquardt",),
                    ("raw there, mm", "RMSE at held-out, mm", "noise there, mm"),
                ),
            ),
            tuple(f"training/{name}.png" for name in ("readings", "errors", "histograms", "deviations")),
        ),
        *(_loops(count) for count in TABLE_II),
        Item(
            "Inliers overall",
            "+25.17 % with the network, from the means over table II",
            (
                Gain("{} with the network", _LOOPS, "with (2)", "inliers without"),
                Gain("{} on the map from known poses", _LOOPS, "with (3)", "inliers of known poses without"),
            ),
        ),
        Item(
            "Size of the map",
            "15.7 × 42.6 m without the network, 15.95 × 43.10 m with it; true size 15.9 × 43 m",
            _with_and_without("{} m", "map, m"),
        ),
        Item(
            "Figures 17 and 18",
            "CPU load within a minute: 30–40 % at 30 particles, 100 % at 800",
            _with_and_without("{} ms per scan, {} s of CPU time", "ms per scan", "CPU seconds"),
        ),
        Item(
            "Figures 14 to 16",
            "Maps of the corridor: the ground truth, not closed without the network, closed with it",
            _with_and_without("share of walls drawn once {}", "walls drawn once"),
            ("maps.png",),
        ),
    ),
)

PAPERS = (LIANG, YANG, JAMALUDIN)
