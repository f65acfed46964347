"""Meaning of the fields of `summary.json`."""

from __future__ import annotations

from ruptfx import Table
from ruptfx.input.fields import extensive_unit

UNITS_OF_FRACTURE = {
    "first_peak_stress": "Pa",
    "largest_stress": "Pa",
    "elastic_modulus": "Pa",
    "first_peak_time": "s",
    "failed_length": "m",
}
UNITS_OF_SURFACES = {
    "moment": "N m", "rupture_area": "m2", "rupture_speed": "m/s", "stress_drop": "Pa", "radiated_energy": "J",
}  # fmt: skip
UNITS_OF_EVENTS = {
    "shortest_event_interval": "s", "longest_event_interval": "s", "largest_event_time": "s",
    "largest_event_slip": "m", "largest_event_stress_drop": "Pa", "largest_event_front_speed": "m/s",
}  # fmt: skip
UNITS = {
    "tip_speed": "m/s",
    "tip_speed_error": "m/s",
    "peak_slip_rate": "m/s",
    "fastest_trailing_speed": "m/s",
    "max_slip": "m",
    "max_opening": "m",
    "reach": "m",
    "pulse_width": "m",
    "pulse_spacing": "m",
    "first_sliding": "s",
    "healing_time": "s",
    **UNITS_OF_FRACTURE,
    **UNITS_OF_SURFACES,
    **UNITS_OF_EVENTS,
}  # units of the summary; every other entry is a name or a pure number

DESCRIPTIONS = {
    "interface": "Name of the interface with the largest slip, which the scalars of modes, speeds and stresses are of.",
    "interfaces": "Of several interfaces: table of these scalars for each by name, as interfaces.NAME.mode.",
    "mode": "Sliding mode: crack, pulse, train, mixed, arrested, none or not resolved.",
    "mode_missing": "Reason why there is no mode.",
    "mode_at_half_threshold": "Mode with half the slip-rate threshold.",
    "mode_before_arrest": "Pattern of sliding before arrest, also set if it is not resolved.",
    "mode_confidence": "Share of saved times and thresholds that agree with the pattern; 0 where it is not resolved.",
    "tip_speed": "Speed of the leading tip, fitted to its arrivals.",
    "tip_speed_error": "Standard error of the fit.",
    "tip_speed_over_c_R": "The same over the Rayleigh speed; wave speeds here and below are those beside the interface "
    "where the tip speed is fitted, along it, of the side with the slower shear waves.",
    "tip_speed_over_c_s": "The same over the shear wave speed.",
    "tip_speed_over_c_l": "The same over the longitudinal wave speed, in plane stress that of the plate.",
    "speed_regime": "sub-Rayleigh, sub-shear (between c_R and c_s), supershear (c_s to the fastest wave of both "
    "sides), not resolved or unknown.",
    "not_resolved": "Reason why the mesh does not resolve the mode or the speed; null if no indicator was found.",
    "peak_slip_rate_resolved": "True if the peak of the largest slip rate is several nodes wide.",
    "reach": "The part of the interface that the tip ran through.",
    "sliding_fraction": "Share of the interface behind the tip that slides, median over the second half of its way.",
    "zones": "Number of sliding zones behind the tip, median over the second half of its way.",
    "pulse_width": "Median width of the sliding zones away from the loaded end; null for a crack.",
    "pulse_width_scatter": "Relative standard deviation of the width.",
    "pulse_width_points": "Median number of interface points of a zone.",
    "pulse_spacing": "Median distance between the centres of neighbouring zones.",
    "pulse_spacing_scatter": "Relative standard deviation of the spacing.",
    "healing_time": "Median duration of the first sliding of a point; null if most points never stopped.",
    "trailing_fronts": "Number of fronts behind the tip that ran through a tenth of the reach.",
    "fastest_trailing_speed": "Speed of the fastest of them.",
    "trailing_fronts_faster_than_c_l": "Number of them that are faster than the longitudinal wave.",
    "crack_degree": "Continuous measure from 0 to 1 of how close the run is to a crack.",
    "pulse_degree": "The same for a pulse.",
    "train_degree": "The same for a train of pulses.",
    "pulses_into_crack_degree": "The same for pulses that become a crack.",
    "noise": "Fraction of the slip-rate energy behind the tip at the shortest wavelength, median over its way.",
    "first_sliding": "Time at which the slip rate first passed `output.rupture_threshold`, of all interfaces.",
    "peak_slip_rate": "Largest slip rate of all points, records and interfaces.",
    "max_slip": "Largest slip of all interfaces.",
    "max_opening": "Largest opening of all interfaces.",
    "slip_events": "Only where the record has several: number of periods in which some point slips faster than 1 mm/s; "
    "less time between two than a shear wave needs along the interface counts as none.",
    "slip_events_complete": "Number of those that begin and end within the record, which the magnitudes, slip, "
    "stress drop and front speed of events are of.",
    "shortest_event_interval": "Shortest time from the begin of an event, complete or not, to that of the next.",
    "longest_event_interval": "Longest such time.",
    "largest_event_time": "Begin of the event with the largest moment, of a line with the largest slip times length.",
    "largest_event_magnitude": "Moment magnitude of this event; null of a line.",
    "smallest_event_magnitude": "Smallest moment magnitude of all events; null of a line.",
    "largest_event_slip": "Largest slip of a point in the largest event.",
    "largest_event_stress_drop": "Decrease of the shear traction in the largest event, weighted with the slip.",
    "largest_event_front_speed": "Median speed of the front of the largest event; null where it is not known.",
    "largest_event_front_missing": "Reason why it is not known.",
    "moment": "Seismic moment: shear modulus times slip of the whole record, creep included, integrated over all "
    "surfaces; beside two bodies the harmonic mean of their moduli (Wu and Chen 2003).",
    "moment_magnitude": "Its moment magnitude (Hanks and Kanamori 1979); null where a surface has several slip "
    "events: its moment is not that of one.",
    "rupture_area": "Area of all surfaces that ruptured.",
    "rupture_speed": "Median of one over the gradient of the rupture time, where there is a front; null without one, "
    "and where a surface has several slip events.",
    "supershear_share": "Share of that part of the surface on which the front is faster than the shear wave beside it; "
    "null where it has several slip events.",
    "stress_drop": "Fall of the shear traction of all surfaces from the initial one and what nucleations have added, "
    "weighted with the slip (Noda et al. 2013); null where a surface has several slip events.",
    "radiated_energy": "Energy radiated by all surfaces: mean work of the initial and final tractions on the slip, "
    "less what friction and cohesion take; null unless the rupture is over and driven by its initial stress alone.",
    "first_peak_stress": "Of a rectangular specimen, positive in compression: first maximum that is followed by a "
    "fall of 3 % before it is exceeded; force over width.",
    "first_peak_strain": "Approach of the ends of the specimen over its height at that time.",
    "first_peak_time": "Time of the first peak.",
    "largest_stress": "Largest absolute stress of the specimen.",
    "elastic_modulus": "Slope of its stress over strain between 20 and 50 % of the first peak.",
    "events": "Number of facets that failed.",
    "events_before_peak": "Number of those before the first peak with a radiated magnitude of at least -10; of the "
    "whole run where there is no peak, here and below.",
    "aseismic_share": "Fraction of the facets that failed before the peak with a smaller magnitude, or none.",
    "tensile_share": "Fraction of `events_before_peak` that opened: until the first peak, the window of Zhao (2013).",
    "shear_share": "Fraction of them that slipped.",
    "mixed_share": "Fraction of them that opened and slipped.",
    "tensile_share_until_95": "Tensile part of the events until 95 % of the time of the first peak.",
    "tensile_share_until_98": "Tensile part of the events until 98 % of that time.",
    "largest_magnitude": "Largest magnitude of all events.",
    "b_value": "b-value of clusters of events of the whole run: closer than three facets, within the time that "
    "half the shear wave speed of the slowest body beside facets needs for that.",
    "b_value_error": "Its standard error.",
    "b_value_of_facets": "b-value of single events before the peak; it depends on M_c, as magnitudes span little.",
    "b_value_of_facets_error": "Its standard error.",
    "fractal_dimension": "Correlation dimension of events before the peak, over two facets to a third of the "
    "narrower side.",
    "fractal_dimension_error": "Its standard error.",
    "omori_exponent": "Omori exponent of the rate of events before the peak.",
    "omori_exponent_error": "Its standard error.",
    "failed_length": "Length of all facets that failed; notches, which were open from the start, are not counted.",
    "fragments": "Number of fragments at the last snapshot.",
    "energy_closure": "Unaccounted energy over the work of the boundaries.",
    "error_bars": "Only after `ruptfx converge`: half-width of the error bar of numbers by name, of what, and why a "
    "number is not in the asymptotic range.",
    "wall_time": "Wall-clock time of the run.",
    "steps": "Number of time steps.",
    "time_step": "The last time step.",
    "nodes": "Number of nodes of the mesh.",
    "ended_by": "`duration`, or the rule of `stop_when` that ended the run.",
    "node_updates_per_second": "Nodes times steps over the time of the steps.",
    "ranks": "Number of MPI ranks.",
    "title": "Title of the case.",
    "case_hash": "Fingerprint of the case and its plug-ins.",
    "versions": "Versions of ruptfx and of its libraries.",
    "host_cores": "Number of cores of the machine.",
}
"""Descriptions by name, in the order of the file; undefined values are null there."""

_UNITS = {
    "wall_time": "s", "time_step": "s", "node_updates_per_second": "1/s", "seconds": "s", "run_time": "s",
    "D_c": "m", "K_c": "N/m", "normal_force": "N", "stiffness": "N/m", "onset_frequency": "Hz",
}  # fmt: skip


def unit(name: str, plane: str = "") -> str:
    """Return the unit of a field, empty for names and pure numbers.

    Parameters
    ----------
    plane : str
        Of the case, for the energies in tables of studies; without it these have no unit.
    """
    name = name.rpartition(".")[2]
    is_energy = plane and name.startswith("energy_") and name != "energy_closure"
    return (UNITS | _UNITS).get(name, extensive_unit("J", plane) if is_energy else "")


def flat(summary: Table) -> Table:
    """Return the scalars of a summary with those of its interfaces, as `interfaces.NAME.mode`."""
    entries = {name: value for name, value in summary.items() if name not in ("interfaces", "error_bars")}
    tables = summary.get("interfaces") or {}
    return entries | {
        f"interfaces.{interface}.{name}": value for interface, table in tables.items() for name, value in table.items()
    }
