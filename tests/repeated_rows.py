"""Rows of tests that protect what other rows protect, and take long: they are `matrix`, and run in ``make test-all``.

Of a test with several parameters, `make test` runs each value of each, not each pair. `REPEATED` has further rows,
beside the rows that stay. Patterns are those of `fnmatch`, of a file and the name of a test.
"""

from collections import Counter
from fnmatch import fnmatchcase
from functools import cache

ROWS_OF_BACKENDS = {"numba": ("codegen", "jax_backend"), "jax": ("codegen", "jax_backend", "system")}
"""Folders whose rows of a backend stay: numba runs the loops of llvm, and JAX its own on the same kernels."""

LONG_SCRIPTS = (
    "a14",
    "a21",
    "a24",
    "a25",
    "a26",
    "a28",
    "a29",
    "a30",
    "a32",
    "a34",
    "a35",
    "a36",
    "a37",
    "a39",
    "a40",
    "a41",
    "a42",
    "a43",
    "a44",
    "a45",
    "a46",
    "a47",
    "a48",
    "a49",
    "a50",
    # their scenes are hard cases or stand on pages of the documentation; of each kind a script stays
    *("a02", "a03", "a05", "a06", "a07", "a08", "a10", "a15", "a16", "a18", "a20", "a23"),
    *("a09", "a13", "a17", "a31", "a38"),
)
"""Scripts of the gallery that take more than a few seconds, or whose scenes run elsewhere."""

WHOLE = ("hard_cases/test_motions.py",)
"""Files whose products run whole: other tests there need the same runs."""

REPEATED = (
    # pages, in C and in a browser: test_pages, and contacts in C beside it
    ("export/test_contact_simulators.py", "test_a_page_moves_as_in_simulate_and_shows_what_contacts_do"),
    ("export/test_contact_simulators.py", "test_two_rough_contacts_that_open_fit_in_a_page"),
    ("export/test_fmu_contacts.py", "test_an_importer_may_find_events_late"),
    # events on a page: beside inputs, beside contacts and beside controllers
    ("export/test_events.py", "test_a_page_has_events"),
    # dop853 beside contacts, and beside events, stays; events and inputs beside contacts by taylor and radau
    (
        "export/test_events_beside_contacts.py",
        "test_events_are_counted_and_map_the_state_between_impacts[[]dop853]",
    ),
    (
        "export/test_contact_simulators.py",
        "test_inputs_are_set_at_the_ends_of_runs_and_between_steps[[]dop853-*",
    ),
    # inputs beside contacts: with events by taylor (test_events_beside_contacts.py), in a unit (test_fmu_contacts.py)
    ("export/test_contact_simulators.py", "test_inputs_are_set_at_the_ends_of_runs_and_between_steps[[]taylor-*"),
    # units by dop853 of a plate whose contact opens and closes: the C of its simulator in test_contact_simulators.py,
    # and its unit in model exchange; the block on a belt and the ball are units for co-simulation
    ("export/test_fmu_contacts.py", "test_motions_in_phases_are_those_of_simulate[[]plate pushed and pulled-*"),
    # units of FMI 2.0 with contacts and events: those of 3.0 stay, and plain ones of both
    ("export/test_fmu_contacts.py", "test_inputs_make_contacts_slip_and_stick[[]2.0]"),
    ("export/test_fmu_contacts.py", "test_an_importer_takes_it[[]2.0]"),
    ("export/test_fmu_events.py", "test_sources_have_no_warnings[[]2.0]"),
    ("export/test_fmu_events.py", "test_an_importer_takes_it[[]2.0]"),
    ("export/test_fmu_events.py", "test_controllers_act_beside_events[[]2.0]"),
    # taylor beside contacts alone, and beside contacts and events, and each method beside events, stay
    ("export/test_controllers.py", "test_controllers_act_beside_contacts_that_change[[]dop853*"),
    ("export/test_controllers.py", "test_controllers_act_beside_contacts_that_change[[]radau*"),
    # inputs beside contacts, and events beside them by taylor, stay
    ("export/test_events_beside_contacts.py", "test_inputs_are_set_beside_events_and_contacts[[]dop853*"),
    # second derivatives of runs: test_a_product_with_a_hessian stays
    ("jax_backend/test_jax_second.py", "test_products_with_hessians_in_batches"),
    # loops of four kinds by all formulations, and random ones, stay
    ("fuzz/loops/test_loops.py", "test_long_loops_move_as_derived_by_hand*"),
    # lanes of other instruction sets: the parts for the least and between
    ("codegen/test_target.py", "test_targets_give_the_same_motions_with_lanes_of_their_own"),
    # chains on a base that turns, and on one that moves in a plane, stay
    ("mechanics/test_many_bodies.py", "test_chains_on_moving_bases_are_those_of_the_dense_matrix[[]satellite-*"),
    ("mechanics/test_many_bodies.py", "test_chains_on_moving_bases_are_those_of_the_dense_matrix[[]aircraft-*"),
    # a rocking block in test_gallery and hard cases stays
    ("fuzz/contacts/test_closed_forms.py", "test_a_plate_rocks_to_rest*"),
    # derivatives by complex steps: of the sleigh, and of the sphere in minimal coordinates
    ("jax_backend/test_jax_derivatives.py", "test_derivatives_are_those_of_complex_steps[[]edge_plate-*"),
    ("jax_backend/test_jax_derivatives.py", "test_derivatives_are_those_of_complex_steps[[]corner_plate-*"),
    # branches that are not taken: test_vector_fields_with_singular_branches, and the guarded functions
    ("jax_backend/test_jax_derivatives.py", "test_singular_branches_that_are_not_taken_give_no_nan"),
    # traced runs: by tsit5, kvaerno5 and Taylor steps; those of diffrax in minimal coordinates
    ("jax_backend/test_jax_pure.py", "test_solve_gives_what_simulate_gives[[]dopri8]"),
    ("jax_backend/test_jax_lanes.py", "test_sweeps_are_those_of_numba[[]dopri8-*"),
    ("jax_backend/test_jax_lanes.py", "test_sweeps_are_those_of_numba[[]kvaerno5-*"),
    ("jax_backend/test_jax_agreement.py", "test_motions_are_those_of_numba[[]edge_plate-*"),
    # derivatives by times, values and jumps: one kind of steps a mode
    ("jax_backend/test_jax_times.py", "test_derivatives_by_times_are_differences[[]tsit5-projected-reverse]"),
    ("jax_backend/test_jax_times.py", "test_derivatives_of_a_known_motion_alone_and_in_batches[[]kvaerno5-*"),
    ("jax_backend/test_jax_inputs.py", "test_derivatives_by_values_are_differences[[]cubic]"),
    ("jax_backend/test_jax_hosted_inputs.py", "test_an_event_at_a_jump_has_no_derivative_and_others_keep_theirs"),
    ("jax_backend/test_jax_jumps.py", "test_derivatives_behind_a_jump_in_the_state*[[]taylor-*"),
    ("jax_backend/test_jax_foreign_batches.py", "test_gradients_of_batches_go_along_the_steps_of_its_cases[[]times]"),
    ("jax_backend/test_jax_second.py", "test_products_with_hessians[[]*"),
    ("system/test_switch_departures.py", "test_traced_runs"),
    ("system/test_rolling_resistance.py", "test_a_ball_slides_then_rolls_then_stops[[]jax-*"),
    ("jax_backend/test_jax_second.py", "test_all_ways_to_nest*[[]reverse of forward]"),
    ("jax_backend/test_jax_second.py", "test_all_ways_to_nest*[[]forward twice]"),
    ("jax_backend/test_jax_second.py", "test_all_ways_to_nest*[[]hessian]"),
    # implicit steps in traced runs: test_what_is_not_finite_is_a_status_in_traced_code, and beside those of diffrax
    ("jax_backend/test_jax_pure.py", "test_solve_gives_what_simulate_gives[[]kvaerno5]"),
    # motions of the sleigh in both formulations: test_jax_lanes.py and test_jax_backend.py; the plate stays
    ("jax_backend/test_jax_agreement.py", "test_motions_are_those_of_numba[[]chaplygin_sleigh-*"),
    ("jax_backend/test_jax_agreement.py", "test_motions_are_those_of_numba[[]rolling_sphere-*"),
    # beside SciPy, the sleigh in two formulations; of the sphere, test_final_state_is_exact
    ("jax_backend/test_jax_backend.py", "test_final_state_is_that_of_scipy[[]slow nutation-*"),
    # one loop of implicit steps: its errors and final states stay
    ("jax_backend/test_jax_lanes.py", "test_steps_that_run_out[[]kvaerno5]"),
    # blocks of steps follow each other alike whatever the pair: dopri8 stays
    ("jax_backend/test_jax_backend.py", "test_legs_leave_no_trace[[][!d]*"),
    # SciPy's solvers, which are driven alike: dop853 and lsoda stay, and bdf where events are found
    ("runs/test_component_tolerances.py", "test_components_of_very_different_sizes[[]numpy-bdf]"),
    ("events/test_events.py", "test_pendulum_through_its_lowest_point[[]numpy-rk45]"),
    # the search by NumPy: the same functions, whatever steps they search
    ("events/test_flat_functions.py", "test_extrema_and_means_end[[]numpy-dop853]"),
    ("system/test_knot_departures.py", "test_traced_runs"),  # test_switch_departures.py has such runs
    # the first use of a process by threads: with contacts, whose kernels are compiled, and whose loops are loaded
    ("runs/test_threads.py", "test_first_use_of_a_process_by_eight_threads[[]*-False]"),
    ("codegen/test_loops.py", "test_first_and_later_processes_do_without_numba_and_agree[[]sweeps]"),
    # motions of many contacts by one program and by one a mode: feet that slip, stick, land and lift
    ("phases/test_common_program.py", "test_boxes_share_loads_by_one_program_as_by_one_a_mode"),
    ("phases/test_controllers_with_contacts.py", "test_an_unstable_loop_on_a_floor_is_called_divergent[[]numpy]"),
    # the mechanism at both ends of the tolerances
    ("hard_cases/test_motions.py", "test_ggl_on_andrews_mechanism[[]1e-07]"),
    # the level turntable by ggl, and the tilted one by the other formulations, stay
    ("hard_cases/test_motions.py", "test_ggl[[]sphere on a tilted turntable]"),
    # long chains of constraints
    ("hard_cases/test_published.py", "test_forty_windows_whose_bars_do_not_turn[[]augmented]"),
    ("system/test_singular.py", "test_sweeps_end_where_single_runs_do[[]1e-05-*"),
    ("system/test_crossed_branches.py", "test_runs_into_the_crossing_end_by_name[[]*-1e-0[68]]"),
    # XLA compiles its sampler for half a minute; a13_parameter_fit.py and a36_record_fit.py go along gradients, too
    ("test_gallery.py", "test_script_runs_and_draws[[]a27_bayesian_fit]"),
    # what these show is tested elsewhere: gradients, fits, tables, inputs, sweeps, published mechanisms
    *(("test_gallery.py", f"test_script_runs_and_draws[[]{name}_*") for name in LONG_SCRIPTS),
    ("test_documents.py", "test_code_runs_as_written[[]environments.md]"),
    # of each family a scene stays
    ("fuzz/test_fuzz.py", "test_a_random_scene_agrees_with_the_reference[[]467]"),
    ("fuzz/contacts/test_closed_forms.py", "test_a_rod_lies_down_in_a_corner[[]0.2-0.3]"),
    ("fuzz/contacts/test_shared_loads.py", "test_shared_loads_lie_within_the_cones*[[]slope]"),
    ("fuzz/contacts/test_shared_loads.py", "test_shared_loads_lie_within_the_cones*[[]corner]"),
    # the formulation augmented: baumgarte has the same loops, and more drift
    ("system/test_singular.py", "test_sweeps_end_where_single_runs_do[[]1e-09-augmented]"),
    ("system/test_singular.py", "test_cases_of_a_sweep_that_are_redundant*[[]augmented]"),
    ("system/test_crossed_branches.py", "test_no_run_that_succeeds_is_on_a_wrong_branch[[]augmented]"),
    ("system/test_redundant_loops.py", "test_mechanisms_that_lock_do_not_succeed[[]augmented]"),
    # the search by NumPy on the backend of Python: the same functions, a hundred times slower
    ("system/test_long_steps.py", "test_thousands_of_events_in_one_step_are_all_found[[]numpy]"),
    # JAX beside other backends: where it is differentiated (test_jax_solves_and_differentiates,
    # test_pairs_of_jax_stop_at_knots_and_are_differentiated), and narrow pulses (test_jax_finds_it*)
    ("system/test_first_order_states.py", "test_every_backend[[]jax-crane]"),
    ("system/test_short_passages.py", "test_short_passages_on_other_backends[[]jax-tsit5]"),
    # `make lint`, with which `make test` begins, checks the same
    ("test_prose.py", "test_the_project_has_none"),
    # pages whose scripts compute long before their first run, and a page of each kind stays
    *(
        ("export/test_live_pages.py", f"test_pages_of_the_site[[]{name}]")
        for name in (
            *("three_blocks", "unicycle", "bicycle", "delta_robot", "squeezing_mechanism", "backlash"),
            *("monorail", "furuta_pendulum", "rocking_block", "stewart_platform", "rattleback"),
        )
    ),
    *(  # conditions of each kind stay
        ("export/test_time_conditions.py", f"test_breaks_are_those_of_simulate[[]{name}]")
        for name in ("parabola", "steps of steps", "rational", "rectified", "powers", "smooth")
    ),
    # one page and two motions by steps of each kind
    ("export/test_pages.py", "test_ready_scenes_move_as_in_simulate[[]rolling_sphere]"),
    (
        "export/test_contact_simulators.py",
        "test_motions_in_phases_are_those_of_simulate[[]rod that falls on the ground-radau]",
    ),
    (  # the page has the same simulator
        "export/test_contact_simulators.py",
        "test_motions_in_phases_are_those_of_simulate[[]block on a belt-auto]",
    ),
    (
        "export/test_contact_simulators.py",
        "test_motions_in_phases_are_those_of_simulate[[]plate through the upright position-auto]",
    ),
    # a cluster: with contacts (test_stored_contacts.py), after a restart
    ("store/test_stored_sweeps.py", "test_a_cluster_gives_the_same_bits"),
    # runs of JAX beside those of the compiled backends: of friction, contacts, loops and quadrature that stay
    ("system/test_grouped_loops.py", "test_other_backends[[]jax]"),
    ("system/test_redundant_loops.py", "test_other_backends[[]jax]"),
    ("system/test_poisson_impacts.py", "test_backends[[]jax]"),
    ("system/test_compliances.py", "test_two_hinges_share_the_weight_as_their_stiffnesses[[]jax]"),
    ("system/test_vanishing_lengths.py", "test_other_backends[[]jax-taylor]"),
    ("codegen/test_numba_backend.py", "test_motions_agree_with_llvm[[]chaplygin_sleigh-projected-taylor]"),
    ("hard_cases/test_published.py", "test_forty_windows_whose_bars_do_not_turn[[]projected]"),
    # a stack of twelve contacts, and feet that slip: boxes and feet by one program stay
    ("phases/test_common_program.py", "test_feet_slip_and_stick_by_one_program_as_by_one_a_mode"),
    ("phases/test_common_program.py", "test_a_stack_of_twelve_contacts_tilts"),
    # the limit of friction: a jump and a rational law stay, by both numbers of feet
    ("system/test_forces_at_limits.py", "test_two_feet_stick_where_one_does[[]from a preload-*"),
    ("system/test_forces_at_limits.py", "test_two_feet_stick_where_one_does[[]minimum-*"),
    ("system/test_forces_at_limits.py", "test_two_feet_stick_where_one_does[[]piecewise-*"),
    ("system/test_equal_bits.py", "test_a_case_has_its_bits_whatever_stands_beside_it[[]numpy-projected-radau]"),
    ("system/test_sparse_series.py", "test_steps_end_before_terms*[[]fifth power and weight]"),
    # pages by the same generator stay; what the text says of both plates is in test_example_13_4_2 and 13_4_4
    ("textbook/test_pages.py", "test_page_is_what_the_code_gives[[]13.4.2-corner-plate]"),
    ("textbook/test_pages.py", "test_page_is_what_the_code_gives[[]13.4.4-edge-plate]"),
    # holonomic constraints of one plate, and those that are not integrable, stay
    ("textbook/test_example_13_4_6.py", "test_remark_13_4_9_multipliers_and_maggi_agree[[]edge_plate]"),
    # Newton that ends where rounding moves multipliers alone: the lesser tolerance takes more steps of the same
    ("reduction/test_formulations.py", "test_ggl_of_nearly_dependent_constraints[[]1e-12]"),
    # NumPy on functions that other rows run compiled; further tests of NumPy run the same steps and searches
    ("events/test_events.py", "test_pendulum_through_its_lowest_point[[]numpy-radau]"),
    ("scene/test_contact_geometry.py", "test_a_coin_in_quaternions[[]numpy]"),
    ("system/test_forces_at_limits.py", "test_tables_that_rise_to_the_limit[[]numpy]"),
    ("system/test_long_steps.py", "test_no_maximum_is_missed_in_a_step_that_has_many[[]numpy]"),
    ("system/test_equal_bits.py", "test_prepared_runs_have_the_bits_of_sweeps*[[]numpy-projected-radau]"),
    ("system/test_knot_starts.py", "test_an_oscillator_let_go_at_a_knot[[]numpy-radau]"),
    ("stops/test_samples.py", "test_contacts_under_samples_that_let_them_stick_and_slip[[]numpy]"),
    ("phases/test_controllers_with_contacts.py", "test_a_held_force_that_jumps_ends_sticking*[[]numpy]"),
    ("starts/test_prepared_starts.py", "test_violations_decay_backward_beside_contacts[[]numpy]"),
    # steep functions of time on JAX: a pulse and a high power stay
    ("system/test_steep.py", "test_numbers_of_jax_are_right[[]friction-*"),
    # growth of operations: from 20 to 40 links, by the same limits
    ("mechanics/test_chains.py", "test_operations_grow_no_faster_than_they_must[[]40-80-*"),
    # a ball joint against Newton's and Euler's laws: test_every_joint of test_sympy_reactions
    ("scene/test_sympy_joints.py", "test_accelerations_are_those_of_sympy[[]ball]"),
    # of three different axes, and of two, one sequence in cyclic order and one in the other stay
    *(
        ("scene/test_orientation.py", f"test_angles_come_back[[]Body {axes}]")
        for axes in ("YZX", "ZXY", "XZY", "YXZ", "XZX", "YZY", "XYX", "ZYZ")
    ),
    # programs of long derivations, and of scenes whose parameters alone differ
    *(
        ("ir/test_text.py", f"test_programs_of_hard_cases[[]{name}]")
        for name in (
            *("Andrews' squeezing mechanism", "heavy top, fast", "heavy top, fast precession"),
            *("heavy top, slow precession", "free body, a hundred tumbles"),
        )
    ),
    ("ir/test_accuracy.py", "test_random_expressions_lose_nothing[[][3-5][0-9]]"),  # thirty seeds stay
    # the energy of mechanisms in a plane: the slider-crank and others in test_they_are_kept_together
    ("starts/test_first_integrals.py", "test_names_and_values[[]Andrews' squeezing mechanism]"),
    # terms of chains: seven links, by the same recursion
    ("oracles/test_oracles.py", "test_chain_terms_equal_the_lagrange_operator_on_its_energies[[]20-*"),
    # every combination of five contacts: of three, and random impacts of each number
    ("system/test_poisson_impacts.py", "test_a_search_finds_what_trying_every_combination_finds[[]5]"),
    ("contacts/test_many_contacts.py", "test_modes_are_found_of_contacts_that_are_redundant[[]10]"),
    # shared loads and folds of loops: the same rows of other formulations stay
    ("system/test_compliances.py", "test_bars_of_a_loop_share_by_compliances[[]baumgarte]"),
    ("system/test_compliances.py", "test_bars_of_a_loop_share_by_compliances[[]augmented]"),
    ("system/test_redundant_loops.py", "test_folds_of_redundant_bars_are_passed_or_end_a_run[[]augmented]"),
    ("system/test_grouped_loops.py", "test_a_group_that_vanishes_where_the_whole*[[]baumgarte]"),
    # guides of one kind: straight ones and curves stay
    ("contacts/test_slip_lines.py", "test_friction_in_the_plane_is_that_along_the_guide[[]decline]"),
    ("contacts/test_slip_lines.py", "test_friction_in_the_plane_is_that_along_the_guide[[]side of a circle]"),
    # steps of pairs: dop853 and taylor stay
    ("system/test_contact_rounding.py", "test_a_gap_that_opens_without_speed_stays_open*[[]tsit5]"),
    ("starts/test_invariant_projection.py", "test_sweeps_are_single_runs[[]dop853]"),
    # the limit of friction along a line and in a plane: one law of each stays, beside the jump
    ("system/test_forces_at_limits.py", "test_a_contact_sticks_at_its_limit[[]from a preload-*"),
    ("system/test_forces_at_limits.py", "test_a_contact_sticks_at_its_limit[[]there and back-*"),
    ("system/test_forces_at_limits.py", "test_a_contact_sticks_at_its_limit[[]rational-*"),
    # terms that no coefficient shows: a pendulum and the fifth power stay
    ("system/test_sparse_series.py", "test_steps_end_before_terms*[[]cube*"),
    # chains of every kind stay, by one length each
    *(
        ("mechanics/test_many_bodies.py", f"test_accelerations_need_no_torques[[]{name}]")
        for name in ("space of 12", "plane of 16", "plane of 12", "space of 7")
    ),
    # random scenes: loops, trees and contacts of each kind stay
    *(("fuzz/loops/test_loops.py", f"test_loops_move_as_derived_by_hand[[]{seed}]") for seed in (3, 4, 5, 7)),
    *(("fuzz/test_fuzz.py", f"test_a_random_scene_agrees_with_the_reference[[]{seed}]") for seed in (9949, 367, 72)),
    ("fuzz/contacts/test_random_contacts.py", "test_two_references_that_miss_the_same*[[]1.0-*"),
    ("corpus/test_corpus.py", "test_random_scenes_end_at_the_reference[[]1000089-*"),
    ("corpus/test_corpus.py", "test_random_scenes_end_at_the_reference[[]1000153-*"),
    # Bricard's mechanism: auto and projected stay
    ("hard_cases/test_published.py", "test_bricard_over_two_periods[[]augmented]"),
    ("hard_cases/test_published.py", "test_bricard_over_two_periods[[]baumgarte]"),
    ("contacts/test_points_of_one_link.py", "test_a_foot_breaks_away_where_no_share*[[]push1-0.7]"),
    # pages whose kind of scene others have
    *(
        ("export/test_live_pages.py", f"test_pages_of_the_site[[]{name}]")
        for name in ("tippe_top", "satellite", "slider_crank", "walker")
    ),
    # traced runs: one kind of steps stays in each
    ("jax_backend/test_jax_backend.py", "test_final_state_is_exact[[]past pi/2-kvaerno5]"),
    ("jax_backend/test_jax_backend.py", "test_error_falls_with_the_tolerance[[]kvaerno5]"),
    ("jax_backend/test_jax_inputs.py", "test_samples_are_those_of_the_compiled_backend[[]hold]"),
    ("jax_backend/test_jax_pure.py", "test_solve_gives_what_simulate_gives[[]tsit5]"),
    ("jax_backend/test_jax_times.py", "test_derivatives_of_a_known_motion_alone_and_in_batches[[]tsit5-forward]"),
    # sources of units without contacts and events stay, which gcc reads with the same warnings
    ("export/test_fmu_events.py", "test_sources_have_no_warnings[[]3.0]"),
    ("export/test_fmu_controllers.py", "test_sources_have_no_warnings[[]3.0]"),
    ("export/test_events_beside_contacts.py", "test_an_event_ends_a_run[[]False]"),
    ("export/test_controllers.py", "test_laws_read_inputs_that_are_set*[[]True-dop853]"),
    ("interop/test_robot_motions.py", "test_two_contacts_of_one_link_that_stick_while_another_slides[[]0.5]"),
    ("codegen/test_numba_backend.py", "test_sweeps_with_events_and_reductions_agree_with_llvm[[]dop853]"),
    # the formulation ggl: these cases by the others, and scenes of each kind by ggl, stay
    *(
        ("hard_cases/test_motions.py", f"test_ggl[[]{name}]")
        for name in (
            *("Andrews' squeezing mechanism", "four-bar with redundant bars", "sphere with unequal moments"),
            *("sphere on a turntable", "Routh sphere", "car axis", "Suslov body"),
        )
    ),
    *(
        ("export/test_live_pages.py", f"test_pages_of_the_site[[]{name}]")
        for name in ("snakeboard", "turntable", "top")
    ),
    # one row of each of these shows the same code
    ("system/test_narrow_pulses.py", "test_sweeps_find_it_in_every_case[[]two smooth steps]"),
    ("system/test_impact_laws.py", "test_a_box_comes_to_rest_on_two_corners[[]newton]"),
    ("starts/test_branches.py", "test_parallel_bars[[]3]"),
    ("system/test_sparse_series.py", "test_steps_end_before_terms*[[]fourth power]"),
    ("system/test_sparse_series.py", "test_steps_end_before_terms*[[]square]"),
    ("textbook/test_first_integrals.py", "test_first_integrals_are_constant_in_simulations[[]edge_plate]"),
    ("system/test_joints_between_bodies.py", "test_textbook_view_agrees[[]slider_crank]"),
    ("system/test_joints_between_bodies.py", "test_force_of_the_pin_in_every_formulation[[]four_bar-ggl]"),
    ("stops/test_samples.py", "test_every_backend_and_method[[]numpy-radau]"),
    ("mechanics/test_copying.py", "test_other_formulations_are_compiled_from_the_equations_at_hand[[]augmented]"),
    ("reduction/test_decimals.py", "test_two_wheels_on_one_axle_by_parameters[[]augmented]"),
    ("starts/test_invariant_projection.py", "test_continuous_output_meets_the_steps*[[]dop853]"),
    # `auto` is `projected` here
    ("reduction/test_constraints.py", "test_reaction_on_a_body_turned_by_a_quaternion_without_a_regular_basis[[]auto]"),
    # closed loops in other units: the closed chain stays; and plates on two points, of which one and block stay
    ("system/test_units.py", "test_starts_are_accepted_and_refused_alike_in_all_units[[]slider-crank-*"),
    ("system/test_units_of_contacts.py", "test_phases_and_motions_are_the_same*[[]plate on ground and corner]"),
    # constraints of rates in the view: test_ready_scenes; states in it: the servo and the crane
    ("system/test_first_order_states.py", "test_the_textbook_view_agrees[[]tricycle]"),
    ("analysis/test_linearize_controllers.py", "test_on_constraints_in_every_formulation[[]augmented]"),
    ("analysis/test_linearize_inputs.py", "test_a_loop_in_every_formulation[[]augmented]"),
    ("jax_backend/test_jax_foreign_batches.py", "test_sweeps_of_both_backends_take_the_same_steps[[]dopri8-*"),
    ("jax_backend/test_jax_single.py", "test_everything_is_single_and_meets_the_tolerances[[]minimal-tsit5]"),
    ("jax_backend/test_jax_inputs.py", "test_derivatives_by_values_are_differences[[]hold]"),
    ("jax_backend/test_jax_jumps.py", "test_a_ramp_is_a_kink_whose_time_may_be_differentiated[[]reverse]"),
    ("jax_backend/test_jax_jumps.py", "test_a_kink_in_the_state_is_no_jump[[]reverse]"),
    ("jax_backend/test_jax_projection.py", "test_steps_whose_ends_cannot_be_projected_are_repeated[[]dopri8]"),
    ("jax_backend/test_linear_maps.py", "test_nested_derivatives[[]kinds[345]]"),
    ("codegen/test_numba_backend.py", "test_motions_agree_with_llvm[[]belt_oscillator-*"),
    # taylor in minimal coordinates by numba: in sweeps, and kernels of the sphere in test_kernels.py
    ("codegen/test_numba_backend.py", "test_motions_agree_with_llvm[[]rolling_sphere-*"),
    # all damages of machine code stay, and the smallest of these files, which are read by the same function
    ("codegen/test_cache.py", "test_damaged_code_of_numba_is_rebuilt_with_a_warning[[]cut *"),
    ("codegen/test_cache.py", "test_damaged_code_of_numba_is_rebuilt_with_a_warning[[]emptied]"),
    ("codegen/test_cache.py", "test_damaged_code_of_numba_is_rebuilt_with_a_warning[[]garbage]"),
    ("fuzz/contacts/test_random_contacts.py", "test_a_random_scene_agrees_with_the_reference[[]stack-21]"),
    ("fuzz/contacts/test_random_contacts.py", "test_a_random_scene_agrees_with_the_reference[[]plate-41]"),
    ("fuzz/contacts/test_closed_forms.py", "test_a_plate_rocks_to_rest[[]0.8]"),
    *(("fuzz/test_fuzz.py", f"test_a_random_scene_agrees_with_the_reference[[]{seed}]") for seed in (39, 69, 447, 609)),
    ("runs/test_interrupts.py", "test_ctrl_c_reaches_runs_that_do_not_end[[]*-a small sweep]"),
    ("runs/test_sweep.py", "test_error_estimate_is_near_the_true_error[[]1e-06]"),
    ("runs/test_sweep.py", "test_a_sweep_is_freed_with_its_last_reference[[]None]"),
    ("system/test_singular.py", "test_sweeps_end_where_single_runs_do[[]1e-09-baumgarte]"),
    ("system/test_forces_at_limits.py", "test_two_feet_stick_where_one_does[[]jump-1]"),
    ("export/test_fmu.py", "test_sources_have_no_warnings[[]2.0]"),
    ("export/test_fmu_exchange.py", "test_rates_that_jump_are_for_co_simulation_alone[[]2.0]"),
    ("export/test_fmu_exchange.py", "test_angles_that_lock_end_a_run[[]2.0]"),
    # what exports do beside events, breaks and inputs: one method each, in turn; by every method events alone
    ("export/test_contact_simulators.py", "test_inputs_are_set_at_the_ends_of_runs_and_between_steps[[]radau-*"),
    ("export/test_events_beside_contacts.py", "test_events_are_counted_and_map_the_state_between_impacts[[]taylor]"),
    ("export/test_events.py", "test_an_event_where_a_run_ends_occurs_once[[][!t]*"),
    ("export/test_events.py", "test_inputs_are_set_beside_events_where_runs_end[[][!d]*"),
    ("export/test_events.py", "test_inputs_are_set_beside_events_between_steps[[][!d]*"),
    # events alone by dop853: beside inputs by it, where runs end and between steps
    ("export/test_events.py", "test_events_are_counted_and_map_the_state[[]dop853]"),
    ("export/test_events.py", "test_states_stay_on_constraints_behind_a_map[[]dop853]"),
    ("export/test_time_conditions.py", "test_events_beside_breaks[[][!t]*"),
    ("export/test_time_conditions.py", "test_controllers_beside_breaks[[][!r]*"),
    ("export/test_time_conditions.py", "test_runs_that_continue_find_the_breaks_that_follow[[][!d]*"),
    ("export/test_controllers.py", "test_controllers_act_beside_events[[][!r]*"),
    ("export/test_c_simulators.py", "test_elementary_functions_are_those_of_simulate_to_the_last_bit[[]dop853]"),
    # units of FMI 2.0 with events, contacts and controllers: those of 3.0 stay
    ("export/test_fmu_contacts.py", "test_the_description_says_what_contacts_do[[]2.0]"),
    ("export/test_fmu_controllers.py", "test_sources_have_no_warnings[[]2.0]"),
    ("export/test_fmu_events.py", "test_events_happen_where_inputs_jump[[]2.0]"),
    ("export/test_fmu_events.py", "test_an_event_ends_the_simulation[[]2.0]"),
    # random scenes of families of which another one stays, and those that take longest
    *(
        ("fuzz/contacts/test_random_contacts.py", f"test_a_random_scene_agrees_with_the_reference[[]{scene}]")
        for scene in ("puck-9917", "rod in corner-2")
    ),
    ("fuzz/test_fuzz.py", "test_a_random_scene_agrees_with_the_reference[[]8959]"),
    # traced runs by pairs of which another one stays
    ("jax_backend/test_jax_foreign_batches.py", "test_a_case_has_the_bits_of_its_run_alone[[]dopri8-*"),
    ("jax_backend/test_jax_times.py", "test_what_was_reached_keeps_its_derivatives[[]tsit5-reverse]"),
    ("system/test_constant_operands.py", "test_jax[[]atan2]"),
    ("system/test_steep.py", "test_numbers_of_jax_are_right[[]high power*"),
    # two windows pass such positions in system/test_singular.py, and loops as long are in mechanics/test_many_loops.py
    ("hard_cases/test_published.py", "test_forty_windows_pass_a_singular_position*"),
    # processes that are killed, or wait for one another: interrupts of other runs, and stores that were cut, stay
    ("test_crashes.py", "test_runs_end_by_name*"),
    ("runs/test_interrupts.py", "test_ctrl_c_reaches_runs_that_do_not_end[[]dop853-a sweep with times]"),
    ("store/test_stored_sweeps.py", "test_processes_that_begin_one_store"),
    ("store/test_stored_refusals.py", "test_a_cluster_that_goes_away_ends_with_a_message"),
    # random scenes with contacts: on a floor, in a slot and with a disc, with events and with inputs, stay
    *(
        ("fuzz/contacts/test_random_contacts.py", f"test_a_random_scene_agrees_with_the_reference[[]{scene}]")
        for scene in ("particle-3", "pendulum-1", "chain-3")
    ),
    ("fuzz/driven/test_driven_contacts.py", "test_a_driven_scene_agrees_with_the_reference[[]controllers-0]"),
    ("fuzz/driven/test_driven_contacts.py", "test_a_driven_scene_agrees_with_the_reference[[]functions-0]"),
)


def repeats(path, name, values):
    """Return whether a test is a repetition, by its file below `tests`, its name, and the values of its parameters."""
    if any(backend in values and not path.startswith(folders) for backend, folders in ROWS_OF_BACKENDS.items()):
        return True
    return any(fnmatchcase(name, pattern) for pattern in _patterns().get(path, ()))


@cache
def _patterns():
    """Return the patterns of `REPEATED` by file."""
    found = {}
    for file, pattern in REPEATED:
        found.setdefault(file, []).append(pattern)
    return found


def repeated_in_products(rows):
    """Return the rows of a test with several parameters that `make test` leaves out.

    Each value of each parameter stays in at least one row. Of rows with as many new values, that one stays whose values
    were taken least often, so that formulations and methods take turns along the scenes.

    Parameters
    ----------
    rows : dict of str to dict
        Values of parameters by the name of the row.
    """
    values = {name: {(key, repr(value)) for key, value in row.items()} for name, row in rows.items()}
    left = set().union(*values.values())
    taken = Counter()
    dropped = dict.fromkeys(rows)
    while left:
        best = min(dropped, key=lambda name: (-len(left & values[name]), sum(taken[each] for each in values[name])))
        left -= values[best]
        taken.update(values[best])
        del dropped[best]
    return list(dropped)
