/* An FMU that does in its second step what a sandbox must refuse, by its parameter `act`.
 *
 * `got` is 0 before, 1 if the access succeeded, and the negative error number if it was refused.
 * With `fails`, do_step then returns an error.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "fmi3Functions.h"

#define UNUSED(x) (void)(x)

enum { Y = 1, ACT, FAILS, GOT, PATH };
enum {
    NOTHING, READ_KEY, TCP, UDP, FORKS, ALLOCATES, EXECS, GROWS, WRITES, TRACES, CHANGES_MODE,
    KILLS, RAISES_LIMIT, STARTS_THREAD, ANSWERS, SHRINKS, READS, DELETES, CONNECTS, FORKS_ONCE
};

typedef struct {
    fmi3Float64 y;
    fmi3Int32 act, fails, got;
    char path[512];
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} instance;

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
    const fmi3ValueReference required[], size_t n_required, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    UNUSED(name), UNUSED(token), UNUSED(resources), UNUSED(visible), UNUSED(logging);
    UNUSED(events), UNUSED(early), UNUSED(required), UNUSED(n_required), UNUSED(update);
    instance *s = calloc(1, sizeof *s);
    s->environment = environment;
    s->log = log;
    return s;
}
void fmi3FreeInstance(fmi3Instance s) { free(s); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance s, fmi3Boolean a, fmi3Float64 b, fmi3Float64 c,
                                       fmi3Boolean d, fmi3Float64 e) {
    UNUSED(s), UNUSED(a), UNUSED(b), UNUSED(c), UNUSED(d), UNUSED(e);
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance s) {
    UNUSED(s);
    return fmi3OK;
}
fmi3Status fmi3GetFloat64(fmi3Instance s, const fmi3ValueReference r[], size_t n, fmi3Float64 x[],
                          size_t n_x) {
    UNUSED(r), UNUSED(n_x);
    for (size_t i = 0; i < n; i++) x[i] = ((instance *)s)->y;
    return fmi3OK;
}
static fmi3Int32 *integer(instance *s, fmi3ValueReference r) {
    return r == ACT ? &s->act : r == FAILS ? &s->fails : &s->got;
}
fmi3Status fmi3GetInt32(fmi3Instance s, const fmi3ValueReference r[], size_t n, fmi3Int32 x[], size_t n_x) {
    UNUSED(n_x);
    for (size_t i = 0; i < n; i++) x[i] = *integer(s, r[i]);
    return fmi3OK;
}
fmi3Status fmi3SetInt32(fmi3Instance s, const fmi3ValueReference r[], size_t n, const fmi3Int32 x[],
                        size_t n_x) {
    UNUSED(n_x);
    for (size_t i = 0; i < n; i++) *integer(s, r[i]) = x[i];
    return fmi3OK;
}
fmi3Status fmi3GetString(fmi3Instance s, const fmi3ValueReference r[], size_t n, fmi3String x[],
                         size_t n_x) {
    UNUSED(r), UNUSED(n_x);
    for (size_t i = 0; i < n; i++) x[i] = ((instance *)s)->path;
    return fmi3OK;
}
fmi3Status fmi3SetString(fmi3Instance s, const fmi3ValueReference r[], size_t n, const fmi3String x[],
                         size_t n_x) {
    UNUSED(r), UNUSED(n), UNUSED(n_x);
    snprintf(((instance *)s)->path, sizeof ((instance *)s)->path, "%s", x[0]);
    return fmi3OK;
}

static void *idle(void *p) { return p; }

/* Gives what the call gave: less than 0 with errno if it was refused. */
static long acts(instance *s) {
    char path[1024];
    switch (s->act) {
    case READ_KEY:
        snprintf(path, sizeof path, "%s/.ssh/id", getenv("HOME"));
        return open(path, O_RDONLY);
    case READS: return open(s->path, O_RDONLY);
    case WRITES: return open(s->path, O_WRONLY | O_CREAT, 0600);
    case DELETES: return unlink(s->path);
    case CHANGES_MODE: return chmod(s->path, 0777);
    case TCP: return socket(AF_INET, SOCK_STREAM, 0);
    case UDP: return socket(AF_INET, SOCK_DGRAM, 0);
    case CONNECTS: {
        struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons((unsigned short)atoi(s->path)),
                                 .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
        return connect(socket(AF_INET, SOCK_STREAM, 0), (struct sockaddr *)&to, sizeof to);
    }
    case FORKS:
        for (;;) fork();
    case FORKS_ONCE: {
        const pid_t made = fork();
        if (made == 0) _exit(0);
        return made;
    }
    case EXECS: return execl("/bin/sh", "sh", "-c", "exit 0", (char *)NULL);
    case ALLOCATES: {
        const int gibibytes = atoi(s->path);
        volatile char *p = malloc((size_t)(gibibytes ? gibibytes : 100) << 30);
        if (p == NULL) return -1;
        p[0] = 1;
        return 0;
    }
    case GROWS:
        for (volatile char *piece;;)
            if ((piece = malloc(1 << 27)) == NULL) return -1;
            else piece[0] = 1;
    case TRACES: return ptrace(PTRACE_ATTACH, getppid(), NULL, NULL);
    case KILLS: return kill(getppid(), SIGKILL);
    case RAISES_LIMIT: {
        const struct rlimit all = {RLIM_INFINITY, RLIM_INFINITY};
        return setrlimit(RLIMIT_AS, &all);
    }
    case STARTS_THREAD: {
        pthread_t thread;
        errno = pthread_create(&thread, NULL, idle, NULL);
        return errno ? -1 : pthread_join(thread, NULL);
    }
    case ANSWERS: /* a pickle that calls os.system; it is written wherever this process can write */
        snprintf(path, sizeof path, "cposix\nsystem\n(S'touch %s'\ntR.", s->path);
        for (int fd = 3; fd < 20; fd++) if (write(fd, path, strlen(path)) > 0) continue;
        return -1;
    case SHRINKS: {
        long shrunk = -1;
        for (int fd = 3; fd < 20; fd++) if (ftruncate(fd, 0) == 0) shrunk = 0;
        return shrunk;
    }
    default: return 0;
    }
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean final,
                      fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *reached) {
    UNUSED(final);
    instance *s = c;
    *event = *end = *early = false;
    *reached = t + h;
    s->y += h;
    if (t < 0.5 * h || s->got) return fmi3OK;
    errno = 0;
    const long done = acts(s);
    s->got = done < 0 ? -errno : 1;
    if (done >= 0 || !s->fails) return fmi3OK;
    s->log(s->environment, fmi3Error, "logStatusError", strerror(errno));
    return fmi3Error;
}
fmi3Status fmi3Terminate(fmi3Instance s) {
    UNUSED(s);
    return fmi3OK;
}
fmi3Status fmi3Reset(fmi3Instance s) {
    UNUSED(s);
    return fmi3OK;
}
