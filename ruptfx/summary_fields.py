"""Meaning of the fields of `summary.json`."""

from __future__ import annotations

from ruptfx import analysis

DESCRIPTIONS = {
    "mode": "Sliding mode: crack, pulse, train, mixed, arrested, none or not resolved.",
    "mode_missing": "Why there is no mode.",
    "mode_at_half_threshold": "The mode when half the slip rate counts as sliding.",
    "mode_before_arrest": "The pattern of sliding whether or not it stopped, and whether or not it is resolved.",
    "mode_confidence": "Share of saved times and thresholds that agree with the pattern; 0 where it is not resolved.",
    "tip_speed": "Speed of the leading tip, fitted to its arrivals.",
    "tip_speed_error": "Standard error of the fit.",
    "tip_speed_over_c_R": "The same over the Rayleigh speed.",
    "tip_speed_over_c_s": "The same over the shear wave speed.",
    "tip_speed_over_c_l": "The same over the longitudinal wave speed, in plane stress that of the plate.",
    "speed_regime": "sub-Rayleigh, sub-shear (between c_R and c_s), supershear (c_s to c_p), not resolved or unknown.",
    "not_resolved": "Why the mesh made the mode or the speed; null where no sign of that was found.",
    "peak_slip_rate_resolved": "Whether the largest slip rate is of a peak several nodes wide.",
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
    "trailing_fronts_faster_than_c_l": "How many of them are faster than the longitudinal wave.",
    "crack_degree": "How near the run comes to a crack, from 0 to 1 without steps.",
    "pulse_degree": "How near it comes to a pulse.",
    "train_degree": "How near it comes to a train of pulses.",
    "pulses_into_crack_degree": "How near it comes to pulses that become a crack.",
    "noise": "Part of the energy of the slip rate behind the tip that is from node to node, median over its way.",
    "first_sliding": "When the slip rate first passed `output.rupture_threshold`.",
    "peak_slip_rate": "Largest slip rate of all points and records.",
    "max_slip": "Largest slip.",
    "max_opening": "Largest opening.",
    "first_peak_stress": "Of a rectangular specimen, positive in compression: first maximum that is followed by a "
    "fall of 3 % before it is exceeded; force over width.",
    "first_peak_strain": "Approach of its ends over its height, then.",
    "first_peak_time": "When that was.",
    "largest_stress": "Largest stress of the specimen, its size.",
    "elastic_modulus": "Slope of its stress over strain between 20 and 50 % of the first peak.",
    "events": "Facets that failed.",
    "events_before_peak": "Those that failed before the first peak and radiate a magnitude of -10 at least; of the "
    "whole run where there is no peak, here and below.",
    "aseismic_share": "Part of the facets that failed before the peak which radiate less, or nothing.",
    "tensile_share": "Part of `events_before_peak` that opened: until the first peak, the window of Zhao (2013).",
    "shear_share": "Part of them that slipped.",
    "mixed_share": "Part of them that did both.",
    "tensile_share_until_95": "Tensile part of the events until 95 % of the time of the first peak.",
    "tensile_share_until_98": "Tensile part of the events until 98 % of that time.",
    "largest_magnitude": "Of all events.",
    "b_value": "Of clusters of events over the whole run: closer than three facets, within the time that half the "
    "slowest shear wave speed needs for that.",
    "b_value_error": "Its standard error.",
    "b_value_of_facets": "Of single events before the peak; their magnitudes span little: it depends on M_c.",
    "b_value_of_facets_error": "Its standard error.",
    "fractal_dimension": "Correlation dimension of events before the peak, over two facets to a third of the "
    "narrower side.",
    "fractal_dimension_error": "Its standard error.",
    "omori_exponent": "Of the rate of events before the peak.",
    "omori_exponent_error": "Its standard error.",
    "failed_length": "Length of all facets that failed; notches, which were open from the start, are not counted.",
    "fragments": "Pieces at the last snapshot.",
    "energy_closure": "What the energy budget does not account for, over the work of the boundaries.",
    "wall_time": "Time the run took.",
    "steps": "Time steps.",
    "time_step": "The last time step.",
    "nodes": "Nodes of the mesh.",
    "ended_by": "`duration`, or the rule of `stop_when` that ended the run.",
    "node_updates_per_second": "Nodes times steps over the time of the steps.",
    "ranks": "MPI ranks.",
    "title": "That of the case.",
    "case_hash": "Fingerprint of the case and its plug-ins.",
    "versions": "Versions of ruptfx and of what it is built on.",
    "host_cores": "Cores of the machine.",
}
"""By name, in the order of the file; what is not defined is null there."""

_UNITS = {"wall_time": "s", "time_step": "s", "node_updates_per_second": "1/s"}


def unit(name: str) -> str:
    """Return the unit of a field, empty for names and pure numbers."""
    return (analysis.UNITS | _UNITS).get(name, "")
