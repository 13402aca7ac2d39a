/* Paths as the host writes them. They are UTF-8. */
#ifndef PATHS_H
#define PATHS_H

#include "names.h"

/* A file URI as a path, and back; to be freed. path_of_uri takes a path as well and returns a copy of it. */
char *path_of_uri(const char *uri);
char *uri_of_path(const char *path);

/* The parts joined by '/', to be freed; NULL ends the list. */
char *path_join(const char *first, ...);

#endif
