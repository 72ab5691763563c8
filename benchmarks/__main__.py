"""``python -m benchmarks accuracy|coverage|speed|peers|papers|judges|render|...``: what is reached, beside aims."""

from __future__ import annotations

import argparse

QUICK_ROWS = "random 5k,clean sets,bunny vertices"
QUICK_SHAPES = "sphere,spot,fandisk,torus mesh,bunny,cube,square"


def main(arguments: list[str] | None = None) -> int:
    """Run one benchmark and return the exit status."""
    chosen = _parser().parse_args(arguments)
    return int(chosen.run(chosen))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    names = "accuracy|coverage|speed|peers|papers|judges|spaces|scans|render|view|files|fuzz"
    commands = parser.add_subparsers(required=True, metavar=names)
    _add_accuracy(commands.add_parser("accuracy", help="errors and intervals of areas, volumes and centroids"))
    _add_coverage(commands.add_parser("coverage", help="how often intervals hold the truth"))
    _add_speed(commands.add_parser("speed", help="times, memory and threads"))
    _add_peers(commands.add_parser("peers", help="the same clouds and solids through other libraries"))
    _add_papers(commands.add_parser("papers", help="the tables and figures of the papers"))
    _add_judges(
        commands.add_parser("judges", help="inside or outside of clouds: wrong answers and times of each judge")
    )
    _add_spaces(commands.add_parser("spaces", help="the coloured grid beside octrees: wrong answers and times"))
    _add_scans(commands.add_parser("scans", help="areas and volumes of differences of two clouds"))
    _add_render(commands.add_parser("render", help="pictures: frame times, edges of cuts, and the reference"))
    _add_view(commands.add_parser("view", help="the page in the browser: steps of a drag, and serving"))
    _add_files(commands.add_parser("files", help="reading and writing beside other libraries"))
    _add_fuzz(commands.add_parser("fuzz", help="damaged files through every reader"))
    return parser


def _common(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--quick", action="store_true", help="a few cases, about a minute")
    parser.add_argument("--out", metavar="FILE.md", help="write the Markdown there, too")


def _add_accuracy(parser: argparse.ArgumentParser) -> None:
    _common(parser)
    parser.add_argument("--only", default="", metavar="ROWS", help="rows by (parts of) names, separated by commas")
    parser.add_argument("--shape", default="", metavar="SHAPES", help="shapes by (parts of) names")
    parser.add_argument("--normals", default="both", choices=("both", "given", "none"))
    parser.add_argument("--set", dest="which", default="judging", choices=("judging", "tuning", "hard"))
    parser.add_argument("--seeds", type=int, metavar="N", help="clouds of each shape, where they are random")
    parser.add_argument(
        "--mode", default="error", choices=("value", "error", "measure"),
        help="the area alone (fastest), with its error (default), or surfel.measure() with lines",
    )  # fmt: skip
    parser.add_argument("--lines", type=int, default=100_000, help="for rows about solids and --mode measure")
    parser.add_argument("--jobs", type=int, default=1, help="cases measured at a time, in processes of their own")
    parser.add_argument("--json", metavar="FILE", help="write one JSON object a case there")
    parser.add_argument("--no-details", action="store_true", help="leave out the table of single cases")
    parser.add_argument("--list", action="store_true", help="say which rows and shapes there are")
    parser.set_defaults(run=_accuracy)


def _accuracy(chosen: argparse.Namespace) -> int:
    from benchmarks import accuracy
    from benchmarks.rows import ROWS, cases
    from benchmarks.tables import publish

    if chosen.list:
        for row in ROWS:
            print(f"{row.name}: {', '.join(row.shapes)}")
        return 0
    only = chosen.only or (QUICK_ROWS if chosen.quick else "")
    shape = chosen.shape or (QUICK_SHAPES if chosen.quick else "")
    todo = list(cases(only, shape, chosen.normals, chosen.which, chosen.seeds))
    if not todo:
        print("no case is left by these filters; --list shows the names")
        return 2
    outcomes = accuracy.run(todo, chosen.mode, chosen.jobs, chosen.lines)
    accuracy.save_json(outcomes, chosen.json)
    if chosen.out is None:
        publish(accuracy.summary(outcomes), None)
    else:
        publish(accuracy.report(outcomes, detailed=not chosen.no_details), chosen.out)
    return 0 if len(outcomes) else 1


def _add_coverage(parser: argparse.ArgumentParser) -> None:
    _common(parser)
    parser.add_argument("what", choices=("trees", "clouds"), help="of what")
    parser.add_argument(
        "--family", default="judging", choices=("judging", "calibrating"),
        help="of clouds: shapes that judge the interval (default), or those that it was fitted to",
    )  # fmt: skip
    parser.add_argument(
        "--rows", metavar="FILE.jsonl", help="of clouds: keep every answer there; those in it are not asked for again"
    )
    parser.add_argument(
        "--minutes", type=float, default=float("inf"), metavar="M", help="of clouds: stop after so long"
    )
    parser.set_defaults(run=_coverage)


def _coverage(chosen: argparse.Namespace) -> int:
    from benchmarks import coverage_clouds, coverage_trees
    from benchmarks.tables import publish

    if chosen.what == "clouds":
        found = coverage_clouds.run(chosen.quick, chosen.family, rows=chosen.rows, minutes=chosen.minutes)
        publish(coverage_clouds.report(found, chosen.family), chosen.out)
    else:
        publish(coverage_trees.run(chosen.quick), chosen.out)
    return 0


def _add_speed(parser: argparse.ArgumentParser) -> None:
    _common(parser)
    parser.add_argument("--only", default="", metavar="PARTS", help="parts by name, separated by commas")
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="runs behind each median")
    parser.set_defaults(run=_speed)


def _speed(chosen: argparse.Namespace) -> int:
    from benchmarks import speed
    from benchmarks.tables import publish

    wanted = [part.strip() for part in chosen.only.split(",") if part.strip()]
    unknown = [part for part in wanted if part not in speed.PARTS]
    if unknown:
        print(f"no such part: {', '.join(unknown)}; there are {', '.join(speed.PARTS)}")
        return 2
    repeats = 1 if chosen.quick else chosen.repeats
    timings = speed.run(tuple(wanted) or (speed.QUICK if chosen.quick else tuple(speed.PARTS)), repeats)
    publish(speed.report(timings, repeats), chosen.out)
    return 0


def _add_peers(parser: argparse.ArgumentParser) -> None:
    _common(parser)
    parser.add_argument("what", choices=("area", "bound", "combine", "csg"), help="what is compared")
    parser.add_argument(
        "--only", default="", metavar="CASES", help="cases by parts of their labels, separated by semicolons"
    )
    parser.add_argument("--methods", default="", help="methods by parts of their names, separated by semicolons")
    parser.add_argument("--no-large", action="store_true", help="leave out the 500,000 points, which take a minute")
    parser.set_defaults(run=_peers)


def _peers(chosen: argparse.Namespace) -> int:
    if chosen.what == "bound":
        return _peers_bound(chosen)
    if chosen.what == "csg":
        return _peers_csg(chosen)
    if chosen.what == "combine":
        return _peers_combine(chosen)
    from benchmarks import peers
    from benchmarks.tables import publish

    there, absent = peers.installed()
    for line in absent:
        print(line)
    methods = {name: method for name, method in there.items() if _named(name, chosen.methods)}
    cases = peers.clouds(quick=chosen.quick, large=not chosen.no_large)
    readings = peers.run(((label, make) for label, make in cases if _named(label, chosen.only)), methods)
    if not readings:
        print("no case is left by these filters")
        return 2
    publish(peers.report(readings, absent), chosen.out)
    return 0


def _peers_csg(chosen: argparse.Namespace) -> int:
    from benchmarks import peers_csg
    from benchmarks.tables import publish

    publish(peers_csg.report(peers_csg.run(chosen.quick)), chosen.out)
    return 0


def _peers_combine(chosen: argparse.Namespace) -> int:
    from benchmarks import peers_combine
    from benchmarks.tables import publish

    publish(peers_combine.report(*peers_combine.run(chosen.quick)), chosen.out)
    return 0


def _peers_bound(chosen: argparse.Namespace) -> int:
    from benchmarks import peers_bound
    from benchmarks.tables import publish

    cases = peers_bound.clouds(quick=chosen.quick)
    answers = peers_bound.run((label, make) for label, make in cases if _named(label, chosen.only))
    if not answers:
        print("no case is left by these filters")
        return 2
    publish(peers_bound.report(answers), chosen.out)
    return 0


def _add_papers(parser: argparse.ArgumentParser) -> None:
    _common(parser)
    papers = ("gaal2005", "li2003", "liu2006", "myles2005")
    parser.add_argument("paper", choices=papers, help="which paper's tables and figures")
    parser.add_argument("--only", default="", metavar="PARTS", help="parts by name, separated by commas")
    parser.set_defaults(run=_papers)


def _papers(chosen: argparse.Namespace) -> int:
    if chosen.paper in ("gaal2005", "li2003", "liu2006"):
        return _papers_whole(chosen)
    from benchmarks import myles2005
    from benchmarks.tables import publish

    wanted = [part.strip() for part in chosen.only.split(",") if part.strip()]
    unknown = [part for part in wanted if part not in myles2005.PARTS]
    if unknown:
        print(f"no such part: {', '.join(unknown)}; there are {', '.join(myles2005.PARTS)}")
        return 2
    publish(myles2005.run(wanted or list(myles2005.PARTS), chosen.out, quick=chosen.quick), chosen.out)
    return 0


def _papers_whole(chosen: argparse.Namespace) -> int:
    """Run all parts of a paper at once."""
    import tempfile
    from importlib import import_module

    from benchmarks.tables import publish

    folder = f"{tempfile.gettempdir()}/surfel-quick" if chosen.quick else "benchmarks/results"
    out = chosen.out or f"{folder}/{chosen.paper}.md"  # pictures go beside it
    publish(import_module(f"benchmarks.{chosen.paper}").run(out, chosen.quick), out)
    return 0


def _add_judges(parser: argparse.ArgumentParser) -> None:
    _common(parser)
    parser.set_defaults(run=_judges)


def _judges(chosen: argparse.Namespace) -> int:
    from benchmarks import judges
    from benchmarks.tables import publish

    publish(judges.report(judges.run(chosen.quick), judges.timings(chosen.quick)), chosen.out)
    return 0


def _add_spaces(parser: argparse.ArgumentParser) -> None:
    _common(parser)
    parser.set_defaults(run=_spaces)


def _spaces(chosen: argparse.Namespace) -> int:
    from benchmarks import spaces
    from benchmarks.tables import publish

    publish(spaces.report(spaces.run(chosen.quick), chosen.quick), chosen.out)
    return 0


def _add_scans(parser: argparse.ArgumentParser) -> None:
    _common(parser)
    parser.set_defaults(run=_scans)


def _scans(chosen: argparse.Namespace) -> int:
    from benchmarks import scans
    from benchmarks.tables import publish

    publish(scans.report(list(scans.run(chosen.quick))), chosen.out)
    return 0


def _add_render(parser: argparse.ArgumentParser) -> None:
    _common(parser)
    parser.set_defaults(run=_render)


def _render(chosen: argparse.Namespace) -> int:
    from benchmarks import render
    from benchmarks.tables import publish

    publish(render.report(chosen.quick), chosen.out)
    return 0


def _add_view(parser: argparse.ArgumentParser) -> None:
    _common(parser)
    parser.set_defaults(run=_view)


def _view(chosen: argparse.Namespace) -> int:
    from benchmarks import view
    from benchmarks.tables import publish

    publish(view.report(chosen.quick), chosen.out)
    return 0


def _add_files(parser: argparse.ArgumentParser) -> None:
    _common(parser)
    parser.add_argument("--repeats", type=int, default=3, metavar="N", help="runs behind each median")
    parser.add_argument("--fuzz", type=int, default=20_000, metavar="N", help="damaged files at the end")
    parser.set_defaults(run=_files)


def _files(chosen: argparse.Namespace) -> int:
    from benchmarks import files, fuzz
    from benchmarks.tables import publish

    rows = files.run(chosen.repeats, chosen.quick)
    count = min(chosen.fuzz, 500) if chosen.quick else chosen.fuzz
    fuzzed = str(fuzz.run(count)) if count else ""
    publish(files.report(rows, chosen.repeats, fuzzed), chosen.out)
    return 0


def _add_fuzz(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--count", type=int, default=20_000, metavar="N", help="how many damaged files")
    parser.add_argument("--first", type=int, default=0, metavar="CASE", help="the number of the first one")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", metavar="PART", help="only seeds whose names hold this")
    parser.set_defaults(run=_fuzz)


def _fuzz(chosen: argparse.Namespace) -> int:
    from benchmarks import fuzz

    report = fuzz.run(chosen.count, chosen.seed, chosen.first, chosen.only)
    print(report)
    return 1 if report.findings else 0


def _named(name: str, wanted: str) -> bool:
    parts = [part.strip() for part in wanted.split(";") if part.strip()]
    return not parts or any(part in name for part in parts)


if __name__ == "__main__":
    raise SystemExit(main())
