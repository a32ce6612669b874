// SPDX-License-Identifier: Apache-2.0
// A wall clock that jumps, for the processes that preload this: the text of the file that
// CLOCK_OFFSET_FILE names is how many seconds it is ahead.  The monotonic clock stays as it is.
//
// libfaketime would do the same, but with its monotonic clock left alone its clock_nanosleep
// fails (0.9.10: EINVAL for absolute times), and with it faked sem_clockwait never returns;
// Python sleeps with the one and waits with the other.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

// Deadlines are taken for those of the wall clock if they lie later than 2001, as Unix time.
static const time_t LATER = 1000000000;

static long offset(void)
{
    static const char *path;
    char text[32] = {0};
    if (!path && !(path = getenv("CLOCK_OFFSET_FILE")))
        return 0;
    int file = open(path, O_RDONLY | O_CLOEXEC);
    if (file < 0)
        return 0;
    ssize_t got = read(file, text, sizeof text - 1);
    close(file);
    return got > 0 ? atol(text) : 0;
}

int clock_gettime(clockid_t clock, struct timespec *now)
{
    int failed = syscall(SYS_clock_gettime, clock, now);
    if (!failed && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE))
        now->tv_sec += offset();
    return failed;
}

int gettimeofday(struct timeval *now, void *zone)
{
    (void)zone;
    struct timespec found;
    int failed = clock_gettime(CLOCK_REALTIME, &found);
    now->tv_sec = found.tv_sec;
    now->tv_usec = found.tv_nsec / 1000;
    return failed;
}

time_t time(time_t *where)
{
    struct timespec found;
    clock_gettime(CLOCK_REALTIME, &found);
    if (where)
        *where = found.tv_sec;
    return found.tv_sec;
}

static struct timespec real(const struct timespec *deadline)
{
    struct timespec own = *deadline;
    if (own.tv_sec > LATER)
        own.tv_sec -= offset();
    return own;
}

int pthread_cond_timedwait(pthread_cond_t *cond, pthread_mutex_t *mutex, const struct timespec *end)
{
    static int (*next)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);
    if (!next)
        next = dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2");
    struct timespec own = real(end);
    return next(cond, mutex, &own);
}

int sem_timedwait(sem_t *semaphore, const struct timespec *end)
{
    static int (*next)(sem_t *, const struct timespec *);
    if (!next)
        next = dlsym(RTLD_NEXT, "sem_timedwait");
    struct timespec own = real(end);
    return next(semaphore, &own);
}

int pthread_mutex_timedlock(pthread_mutex_t *mutex, const struct timespec *end)
{
    static int (*next)(pthread_mutex_t *, const struct timespec *);
    if (!next)
        next = dlsym(RTLD_NEXT, "pthread_mutex_timedlock");
    struct timespec own = real(end);
    return next(mutex, &own);
}
