/* Every name that one file of this FMU has from another, so that two FMUs in one program do not meet (linkage.h). The network's
 * weights have theirs in network_size.h. */
#ifndef NAMES_H
#define NAMES_H

#include "linkage.h"

/* wrapper.c */
#define wrapper_new OWN(wrapper_new)
#define wrapper_free OWN(wrapper_free)
#define wrapper_reset OWN(wrapper_reset)
#define wrapper_started OWN(wrapper_started)
#define wrapper_log OWN(wrapper_log)

/* outer_fmi*.c */
#define host_log OWN(host_log)

/* sampling.c, coupling.c */
#define sampling_step OWN(sampling_step)
#define sampling_row OWN(sampling_row)
#define sampling_sample OWN(sampling_sample)
#define sampling_correction OWN(sampling_correction)
#define coupling_advance OWN(coupling_advance)
#define coupling_parts OWN(coupling_parts)

/* variables.c */
#define solver_run OWN(solver_run)
#define variable_size OWN(variable_size)
#define variable_get OWN(variable_get)
#define variable_set OWN(variable_set)
#define variables_touched OWN(variables_touched)
#define variables_jumped OWN(variables_jumped)

/* inner_*.c */
#define inner_open OWN(inner_open)
#define inner_instantiate OWN(inner_instantiate)
#define inner_close OWN(inner_close)
#define inner_setup OWN(inner_setup)
#define inner_enter_initialisation OWN(inner_enter_initialisation)
#define inner_exit_initialisation OWN(inner_exit_initialisation)
#define inner_terminate OWN(inner_terminate)
#define inner_reset OWN(inner_reset)
#define inner_debug_logging OWN(inner_debug_logging)
#define inner_step OWN(inner_step)
#define inner_events OWN(inner_events)
#define inner_get OWN(inner_get)
#define inner_set OWN(inner_set)
#define inner_numbers OWN(inner_numbers)
#define inner_state_get OWN(inner_state_get)
#define inner_state_set OWN(inner_state_set)
#define inner_state_free OWN(inner_state_free)
#define inner_state_size OWN(inner_state_size)
#define inner_state_write OWN(inner_state_write)
#define inner_state_read OWN(inner_state_read)

/* state.c */
#define state_get OWN(state_get)
#define state_set OWN(state_set)
#define state_free OWN(state_free)
#define state_size OWN(state_size)
#define state_write OWN(state_write)
#define state_read OWN(state_read)

/* platform.c, paths.c */
#define platform_folder OWN(platform_folder)
#define platform_suffix OWN(platform_suffix)
#define library_open OWN(library_open)
#define library_close OWN(library_close)
#define library_function OWN(library_function)
#define own_resources OWN(own_resources)
#define file_exists OWN(file_exists)
#define path_of_uri OWN(path_of_uri)
#define uri_of_path OWN(uri_of_path)
#define path_join OWN(path_join)

/* network*.c */
#define network OWN(network)
#define network_way OWN(network_way)
#define network_baseline OWN(network_baseline)
#define network_avx2 OWN(network_avx2)

/* effects.c */
#define effects_start OWN(effects_start)
#define effects_step OWN(effects_step)

/* wrapped.c */
#define SOURCES OWN(SOURCES)
#define FACTORS OWN(FACTORS)
#define HELD OWN(HELD)
#define CHANNEL_NAMES OWN(CHANNEL_NAMES)
#define UNCORRECTED OWN(UNCORRECTED)
#define TUNABLES OWN(TUNABLES)
#define START_VALUES OWN(START_VALUES)
#define TRAINED OWN(TRAINED)
#define ARRAYS OWN(ARRAYS)
#define WIRED OWN(WIRED)
#define FORCE_INPUTS OWN(FORCE_INPUTS)
#define FORCE_STARTS OWN(FORCE_STARTS)
#define PLACES OWN(PLACES)
#define ANSWERS OWN(ANSWERS)

#endif
