/* SPDX-License-Identifier: Apache-2.0 */
/* The token of a server of the same user on this machine, as bridge/access/token.py writes it. */
#ifndef UUV_TOKEN_H
#define UUV_TOKEN_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#if !defined(_WIN32)
#include <sys/stat.h>
#endif

/* The rule of `token_folder`; 0 if the user has no home directory. */
static int token_folder(char *path, size_t size) {
    const char *named = getenv("UUVSIM_TOKENS"), *base = NULL, *below = "";
    if (named && *named) return snprintf(path, size, "%s", named) < (int)size;
#if defined(_WIN32)
    base = getenv("LOCALAPPDATA");
#elif defined(__APPLE__)
    base = getenv("HOME");
    below = "/Library/Application Support";
#else
    base = getenv("XDG_STATE_HOME");
    if (!base || !*base) {
        base = getenv("HOME");
        below = "/.local/state";
    }
#endif
    if (!base || !*base) return 0;
    return snprintf(path, size, "%s%s/uuvsim-cosim/tokens", base, below) < (int)size;
}

/* Opens the file if it is this user's and nobody else may have read or written it. */
static FILE *token_open(const char *path) {
#if defined(_WIN32)
    return fopen(path, "rb"); /* in the user's profile, whose permissions hold */
#else
    struct stat found;
    const int file = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK);
    if (file < 0) return NULL;
    if (fstat(file, &found) != 0 || !S_ISREG(found.st_mode) || found.st_uid != geteuid() ||
        (found.st_mode & 077)) {
        close(file);
        return NULL;
    }
    return fdopen(file, "rb");
#endif
}

static int token_is_local(const char *host) {
    return !strncmp(host, "127.", 4) || !strcmp(host, "::1") || !strcmp(host, "localhost");
}

/* Writes the token for a server, or "" if this user has none for it. */
static void token_for(const char *host, int port, char *token, size_t size) {
    char machine[256] = "", folder[1024], path[1400];
    const char *given = getenv("UUVSIM_TOKEN");
    token[0] = '\0';
    if (token_is_local(host) && gethostname(machine, sizeof machine - 1) == 0 &&
        token_folder(folder, sizeof folder)) {
        for (char *c = machine; *c; c++)
            if (*c >= 'A' && *c <= 'Z') *c += 'a' - 'A';
        snprintf(path, sizeof path, "%s/%d@%s", folder, port, machine);
        FILE *file = token_open(path);
        if (file) {
            if (!fgets(token, (int)size, file)) token[0] = '\0';
            token[strcspn(token, "\r\n")] = '\0';
            fclose(file);
        }
    }
    if (!token[0] && given) snprintf(token, size, "%s", given);
}

#endif
