/* The resources of a model that reads files: where they are, and reading them. */
#include "instance.h"

#include <stdlib.h>
#include <string.h>

#ifdef MODEL_RESOURCES
static int hex_digit(char c)
{
    return c >= '0' && c <= '9' ? c - '0' : (c | 32) >= 'a' && (c | 32) <= 'f' ? (c | 32) - 'a' + 10 : -1;
}

/* A path that ends in a separator, of a path or of a file URI (RFC 8089, with or without an authority). Free it. */
static char *path_of(const char *folder)
{
    char *path = malloc(strlen(folder) + 2), *to = path;
    const bool uri = !strncmp(folder, "file:", 5);
    if (!path)
        return NULL;
    if (uri) {
        folder += 5;
        if (!strncmp(folder, "//", 2))
            folder += strcspn(folder + 2, "/") + 2;
        if (folder[0] == '/' && folder[1] && folder[2] == ':')
            folder++; /* /C:/ of Windows */
    }
    for (; *folder; folder++) {
        const int high = uri && *folder == '%' ? hex_digit(folder[1]) : -1, low = high >= 0 ? hex_digit(folder[2]) : -1;
        *to++ = low >= 0 ? (char)(16 * high + low) : *folder;
        folder += low >= 0 ? 2 : 0;
    }
    if (to > path && to[-1] != '/' && to[-1] != '\\')
        *to++ = '/';
    *to = '\0';
    return path;
}

Status instance_load(Instance *self, const char *folder)
{
    char message[400] = "no memory";
    char *path = folder ? path_of(folder) : NULL;
    if (path)
        self->resources = model_load(path, message, sizeof message);
    free(path);
    if (self->resources)
        return STATUS_OK;
    return instance_log(self, STATUS_ERROR, "instantiate: %s", folder ? message : "expected the folder of the FMU's resources, got none");
}
#endif
