"""What a command tells when it is done: the plan it followed, its files and its seconds."""


def plan_text(plan):
    """What a plan, as its dict, comes to, in one line: the way; and the result, where that was asked for."""
    way = {"polar": "{section_size} px sections between {azimuths} azimuths",
           "pixels": "a PSF for every pixel, from {azimuths} azimuths",
           "sections": "{section_size} px sections of order {order}" if plan["order"] else "one PSF for the picture",
           "paper": "{section_size} px sections in a space of {space_px} px, as in the paper",
           "exact": "every pixel's own PSF"}[plan["method"]].format(**plan)
    way += ", double precision" if plan["precision"] == "float64" else ", single precision"
    if plan["error_bound"] is None:
        return way
    return (f"{way}: at most {100 * plan['error_bound']:.2g} % of any point's light misplaced; "
            f"about {max(plan['seconds'], 0.1):.1f} s, {plan['memory_mb']:.0f} MB")


def finish(options, report, files):
    """Write the report, and say where the files are, how long each stage took, and what lies out of field."""
    if options.report:
        report.write(options.report)
    for path in files:
        print(path)
    for stage, seconds in report.stages.items():
        print(f"  {stage:<40}{seconds:8.2f} s")
    if report.facts.get("foreign_spectra"):
        print("  the scene holds spectra that its plan did not foresee: render it with --tier reference")
    if report.facts.get("lens_warning"):
        print(f"  {report.facts['lens_warning']}")
    if "depth" in report.facts:
        print(f"  {report.facts['depth']['text']}")
    beyond = report.facts["out_of_field_fraction"]
    if beyond:
        print(f"  {beyond:.1%} of the frame lies beyond the lens data: {report.facts['plan']['out_of_field']}")
