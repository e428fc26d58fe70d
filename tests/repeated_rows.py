"""Rows of tests that protect what other rows protect, and take long: they are `matrix`, and run in ``make test-all``.

A row stands here beside the row that stays. Patterns are those of `fnmatch`, of a file and the name of a test.
"""

from fnmatch import fnmatchcase

NUMBA_ROWS = "codegen", "jax_backend"
"""Folders whose rows of the backend numba stay: they compare it with llvm, which runs the same loops."""

REPEATED = (
    # of four and more programs on two devices, runs with events have all kinds of sharding
    ("jax_backend/test_jax_devices.py", "test_runs_and_gradients_over_two_devices[[]inputs]"),
    ("jax_backend/test_jax_devices.py", "test_runs_and_gradients_over_two_devices[[]meshes]"),
    ("jax_backend/test_jax_devices.py", "test_runs_and_gradients_over_two_devices[[]what cases share]"),
    ("jax_backend/test_jax_devices.py", "test_runs_and_gradients_over_two_devices[[]implicit steps]"),
    # both modes of differentiation, alone and in batches: by Taylor steps
    ("jax_backend/test_jax_pure.py", "test_both_modes*[[]tsit5-projected]"),
    # sweeps of traced loops: those of taylor, dopri8 and kvaerno5 with minimal coordinates, of tsit5 with both
    ("jax_backend/test_jax_lanes.py", "test_sweeps_are_those_of_numba[[]taylor-projected]"),
    ("jax_backend/test_jax_plain.py", "test_traced_loops_agree_with_diffrax[[]kvaerno5-projected]"),
    ("jax_backend/test_jax_plain.py", "test_plain_diffrax_gives_the_same[[]dopri8]"),
    # second derivatives over a break: the Hessian nests forward over reverse mode
    ("jax_backend/test_jax_second.py", "test_all_ways_to_nest*[[]reverse of forward]"),
    ("jax_backend/test_jax_second.py", "test_all_ways_to_nest*[[]forward twice]"),
    # derivatives by complex steps: a row for each scene, formulation and mode stays, at one of two places
    ("jax_backend/test_jax_derivatives.py", "test_derivatives_are_those_of_complex_steps*-forward-somewhere]"),
    # one implicit and one explicit method
    ("runs/test_component_tolerances.py", "test_components_of_very_different_sizes[[]jax-kvaerno5]"),
    ("runs/test_component_tolerances.py", "test_components_of_very_different_sizes[[]jax-dopri8]"),
    ("system/test_surfaces.py", "test_motions_are_those_of_scipy[[]jax-taylor-cubic]"),
    ("system/test_knot_departures.py", "test_traced_runs"),  # test_switch_departures.py has such runs
    # the first use of a process by threads: with contacts, which has all that the others have
    ("runs/test_threads.py", "test_first_use_of_a_process_by_eight_threads[[]shared]"),
    ("runs/test_threads.py", "test_first_use_of_a_process_by_eight_threads[[]sweep]"),
    # an interrupt reaches every loop by one counter, whatever the method
    ("runs/test_interrupts.py", "test_ctrl_c_reaches_runs_that_do_not_end[[]dop853-*"),
    ("codegen/test_loops.py", "test_first_and_later_processes_do_without_numba_and_agree[[]sweeps]"),
    # motions of many contacts by one program and by one a mode: feet that slip, stick, land and lift
    ("phases/test_common_program.py", "test_boxes_share_loads_by_one_program_as_by_one_a_mode"),
    ("phases/test_controllers_with_contacts.py", "test_an_unstable_loop_on_a_floor_is_called_divergent[[]numpy]"),
    # long chains of constraints
    ("hard_cases/test_published.py", "test_forty_windows_whose_bars_do_not_turn[[]augmented]"),
    ("system/test_grouped_loops.py", "test_a_ladder_that_locks_does_not_succeed[[]baumgarte]"),
    ("system/test_grouped_loops.py", "test_a_blade_by_both_components_of_its_slip[[]*-True]"),
    ("fuzz/loops/test_loops.py", "test_long_loops_move_as_derived_by_hand[[]*-1-*"),
    ("system/test_singular.py", "test_sweeps_end_where_single_runs_do[[]1e-05-*"),
    ("system/test_crossed_branches.py", "test_runs_into_the_crossing_end_by_name[[]*-1e-0[68]]"),
    # XLA compiles its sampler for half a minute; a13_parameter_fit.py and a36_record_fit.py go along gradients, too
    ("test_gallery.py", "test_script_runs_and_draws[[]a27_bayesian_fit]"),
    # the limit of friction: a jump, a rational law and one from a preload stay, by both numbers of feet
    ("system/test_forces_at_limits.py", "test_two_feet_stick_where_one_does[[]minimum-*"),
    ("system/test_forces_at_limits.py", "test_two_feet_stick_where_one_does[[]piecewise-*"),
    ("system/test_equal_bits.py", "test_a_case_has_its_bits_whatever_stands_beside_it[[]numpy-projected-radau]"),
    ("system/test_sparse_series.py", "test_steps_end_before_terms*[[]fifth power and weight]"),
    ("system/test_units.py", "test_starts_are_accepted_and_refused_alike_in_all_units[[]*-projected]"),
    (
        "transforms/test_taylor.py",
        "test_a_loop_over_the_orders_gives_the_bits*[[]everything-20-1-[24]]",
    ),
)


def repeats(path, name, values):
    """Return whether a test is a repetition, by its file below `tests`, its name, and the values of its parameters."""
    if "numba" in values and not path.startswith(NUMBA_ROWS):
        return True
    return any(path == file and fnmatchcase(name, pattern) for file, pattern in REPEATED)
