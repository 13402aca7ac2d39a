"""The page of a consistency assessment: verdicts first, then preload, critical speed and running safety, as far as assessed."""

from __future__ import annotations

from fmucorrect.railway.assess import NOTICE, Findings
from fmucorrect.railway.constants import KMH
from fmucorrect.railway.preload.assessment import PreloadAssessment
from fmucorrect.railway.stability.assessment import CriticalSpeedAssessment
from fmucorrect.report.assessment import figures as drawn
from fmucorrect.report.assessment import text
from fmucorrect.report.assessment.safety import add_safety
from fmucorrect.report.assessment.text import given, kmh, percent, short
from fmucorrect.report.base.html import Page, Row


def build(found: Findings) -> Page:
    """The page, ready to be written."""
    title = f"{found.assessment.name}: is the model sound in itself?"
    page = Page(title, lead(found), kicker="fmucorrect assess")
    page.tiles(_tiles(found))
    page.section("Verdicts")
    page.facts(text.verdict_rows(found))
    page.caution(NOTICE)
    page.end()
    if found.preload is not None:
        _preload(page, found.preload)
    if found.critical_speed is not None:
        _critical_speed(page, found.critical_speed)
    if found.safety is not None:
        add_safety(page, found.safety)
    page.section("What was assessed")
    assessment = found.assessment
    values = ", ".join(f"{name} = {value:g}" for name, value in assessment.parameters.items())
    page.facts(
        [
            ("FMU", assessment.fmu.name),
            ("mapping file", assessment.path.name),
            ("communication step", f"{assessment.step_ns / 1e6:g} ms"),
            ("start values", values or "the FMU's own"),
            ("time taken", f"{found.seconds:.0f} s"),
        ]
    )
    page.end()
    return page


def lead(found: Findings) -> str:
    """What the reader is to know first."""
    assessed = [item for item in (found.preload, found.critical_speed, found.safety) if item is not None]
    failed = [
        title
        for (title, _), item in zip(
            text.TITLES.items(), (found.preload, found.critical_speed, found.safety), strict=True
        )
        if item is not None and not item.passed
    ]
    names = [text.TITLES[name].lower() for name in failed]
    if names:
        return f"Not in order: {' and '.join(names)}."
    count = {1: "The one assessment", 2: "Both assessments", 3: "All three assessments"}[len(assessed)]
    return f"{count} that {'was' if len(assessed) == 1 else 'were'} made found nothing out of order."


def _tiles(found: Findings) -> list[tuple[str, str, str, str]]:
    tiles: list[tuple[str, str, str, str]] = []
    if (preload := found.preload) is not None:
        if preload.loads:
            worst = max(preload.loads, key=lambda item: abs(item.error))
            detail = (
                f"of {worst.name} against the independent equilibrium; {given(100.0 * preload.tolerance)} % is allowed"
            )
            tiles.append(("Largest load error", "", percent(abs(worst.error)), detail))
        if preload.residuals:
            detail = f"threshold {given(preload.threshold)}; the paper's model has {text.PAPER_RESIDUAL}"
            tiles.append(("Residual acceleration, m/s²", "", short(preload.residual), detail))
    if (critical := found.critical_speed) is not None:
        linear = critical.linear
        known = linear.critical_speed
        beyond = f"above {kmh(linear.speeds[-1])}" if linear.stable_at_lowest else f"below {kmh(linear.speeds[0])}"
        conicity = "" if critical.conicity is None else f" at conicity {given(critical.conicity)}"
        tiles.append(
            ("Linear critical speed", "", beyond if known is None else kmh(known), f"by {linear.method}{conicity}")
        )
        if critical.bifurcation or critical.deceleration:
            how = "by step-down from the limit cycle" if critical.bifurcation else "while it slows down"
            tiles.append(("Nonlinear critical speed", "", kmh(critical.found("nonlinear")), how))
    if found.safety is not None:
        for name, symbol in (("derailment_quotient", "Y/Q"), ("wheel_unloading", "ΔQ/Q₀")):
            if worst := text.largest(found.safety, name):
                tiles.append((f"Largest {symbol}", "", short(worst.extreme), f"wheel {worst.place}, {worst.section}"))
    return tiles


def _preload(page: Page, found: PreloadAssessment) -> None:
    note = f"Settling over {found.duration:g} s; the last {found.window:g} s are judged."
    if found.disturbed:
        note += " It starts from a disturbed position; “start” is the model's own, undisturbed one."
    page.section(text.TITLES["preload"], note)
    if found.loads:
        page.heading("Loads side by side")
        page.text_block(
            "The independent equilibrium knows the masses, centres of mass, and the supports' places and stiffnesses alone; "
            "the FMU's loads are total transmitted forces, the rod bushes' those between the external markers."
        )
        shown = [("largest error of each group", drawn.loads(found.worst()))]
        page.choice(
            [*shown, ("all loads", drawn.loads(found.loads))] if len(found.loads) > len(found.worst()) else shown
        )
        page.open_fold(f"All {len(found.loads)} loads")
        page.table(["", "FMU, kN", "independent, kN", "error", "reference from"], _load_rows(found))
        page.close_fold()
    if found.internal:
        page.heading("Rod bushes: external force and internal preload")
        page.text_block(
            "A bush with an internal node transmits a stiffness-weighted share of its internal preload, not the preload: "
            "F_ext = (k_par k_ser d + k_ser F₀) / (k_par + k_ser)."
        )
        rows = [
            Row([item.name, short(item.value, 5), short(item.reference, 5), short(found.internal[item.name], 5)])
            for item in found.loads
            if item.name in found.internal
        ]
        page.table(["", "external, N", "expected external, N", "internal preload, N"], rows)
    if found.residuals:
        page.heading("Residual accelerations")
        page.figure(drawn.residuals(found))
    if found.convergences:
        page.heading("Convergence of the force elements")
        page.figure(drawn.settling(found))
        rows = [
            Row(
                [
                    item.name,
                    item.unit,
                    short(item.start, 5),
                    short(item.settled, 5),
                    short(item.share, 2),
                    "never" if item.settling_time != item.settling_time else short(item.settling_time),
                ],
                "" if item.converged else "strong",
            )
            for item in found.convergences
        ]
        page.open_fold(f"All {len(rows)} forces")
        page.table(["", "unit", "start", "settled", "change, share", "settled after, s"], rows)
        page.close_fold()
    page.end()


def _load_rows(found: PreloadAssessment) -> list[Row]:
    rows: list[Row] = []
    for group in dict.fromkeys(item.group for item in found.loads):
        rows.append(Row([group], "group"))
        rows += [
            Row(
                [
                    item.name,
                    f"{1e-3 * item.value:.4f}",
                    f"{1e-3 * item.reference:.4f}",
                    percent(item.error),
                    "balance alone" if item.determinate else "balance and stiffness",
                ],
                "strong" if abs(item.error) > found.tolerance else "",
            )
            for item in found.loads
            if item.group == group
        ]
    return rows


def _critical_speed(page: Page, found: CriticalSpeedAssessment) -> None:
    page.section(text.TITLES["critical_speed"])
    page.heading("Root locus over speed")
    page.text_block(
        f"Eigenvalues of the FMU's linearisation ({found.linear.method}). Right of the dotted line a mode grows. What decays "
        f"faster than {-drawn.SLOWEST:g} 1/s or oscillates faster than {drawn.FASTEST:g} Hz lies outside of the picture: drag "
        "to zoom, double-click for all."
    )
    page.figure(drawn.root_locus(found.linear))
    page.heading("Damping and frequency over speed")
    page.figure(drawn.damping(found))
    if found.deceleration is not None:
        page.heading("Slowing down")
        page.text_block(
            f"Disturbed at the highest speed, then slowed down by {found.deceleration.rate:g} m/s² (the paper's scenario). The "
            "speed at which it comes to rest lies below the end of the limit cycle, by as much as the speed falls meanwhile."
        )
        page.figure(drawn.deceleration(found.deceleration))
    if found.bifurcation is not None:
        page.heading("Bifurcation diagram")
        page.text_block(
            "Where both branches stand at one speed, the size of a disturbance decides whether the vehicle rests or hunts; the "
            "unstable branch is that size."
            + (
                " Where a motion is ringed, a flag of the mapping file rises: it is beyond the model."
                if found.raised
                else ""
            )
        )
        page.figure(drawn.bifurcation_diagram(found.bifurcation, found.linear.critical_speed))
    if found.published:
        page.heading("Beside published values")
        page.text_block(
            "A critical speed belongs to a conicity, a suspension and a contact: values of other vehicles are no target."
        )
        rows = [
            Row(
                [
                    item.name,
                    item.kind,
                    f"{KMH * item.speed:.1f}",
                    "" if (own := found.found(item.kind)) is None else f"{KMH * own:.1f}",
                    given(item.conicity),
                    given(found.conicity),
                    {None: "set beside", True: "met", False: "NOT met"}[found.met(item)],
                ]
            )
            for item in found.published
        ]
        page.table(["", "kind", "published, km/h", "here, km/h", "its conicity", "conicity here", ""], rows)
    page.end()
