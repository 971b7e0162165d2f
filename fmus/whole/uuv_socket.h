/* SPDX-License-Identifier: Apache-2.0 */
/* A TCP connection that never waits for longer than it may; POSIX and winsock2. */
#ifndef UUV_SOCKET_H
#define UUV_SOCKET_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#if defined(_WIN32)
#define WIN32_LEAN_AND_MEAN
#include <winsock2.h>
#include <ws2tcpip.h>
typedef SOCKET uuv_socket;
#define UUV_NO_SOCKET INVALID_SOCKET
#define UUV_NO_SIGNAL 0
static int socket_again(void) { return WSAGetLastError() == WSAEWOULDBLOCK; }
static void socket_close(uuv_socket s) { closesocket(s); }
static int socket_start(void) {
    WSADATA data;
    return WSAStartup(MAKEWORD(2, 2), &data) == 0;
}
static void socket_end(void) { WSACleanup(); }
static int socket_poll(uuv_socket s, int writing, int ms) {
    WSAPOLLFD one = {s, writing ? POLLOUT : POLLIN, 0};
    return WSAPoll(&one, 1, ms);
}
static void socket_unblock(uuv_socket s) {
    u_long on = 1;
    ioctlsocket(s, FIONBIO, &on);
}
static double socket_clock(void) { return (double)GetTickCount64() * 1e-3; }
#else
#include <errno.h>
#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>
typedef int uuv_socket;
#define UUV_NO_SOCKET (-1)
#ifdef MSG_NOSIGNAL
#define UUV_NO_SIGNAL MSG_NOSIGNAL
#else
#define UUV_NO_SIGNAL 0
#endif
static int socket_again(void) {
    return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR || errno == EINPROGRESS;
}
static void socket_close(uuv_socket s) { close(s); }
static int socket_start(void) { return 1; }
static void socket_end(void) {}
static int socket_poll(uuv_socket s, int writing, int ms) {
    struct pollfd one = {s, writing ? POLLOUT : POLLIN, 0};
    return poll(&one, 1, ms);
}
static void socket_unblock(uuv_socket s) { fcntl(s, F_SETFL, fcntl(s, F_GETFL, 0) | O_NONBLOCK); }
static double socket_clock(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}
#endif

/* Waits until the socket can be read or written; 0: not before the end [s]. */
static int socket_wait(uuv_socket s, int writing, double end) {
    for (;;) {
        const double left = end - socket_clock();
        if (left <= 0.0) return 0;
        const int ready = socket_poll(s, writing, left > 3600.0 ? 3600000 : (int)(left * 1e3) + 1);
        if (ready > 0) return 1;
        if (ready < 0 && !socket_again()) return 1; /* the call that follows says what is wrong */
    }
}

/* Connects within `seconds`; UUV_NO_SOCKET, and words, if nobody answers. */
static uuv_socket socket_connect(const char *host, int port, double seconds, char *words,
                                 size_t size) {
    struct addrinfo hints = {0}, *found = NULL;
    char service[16];
    const double end = socket_clock() + seconds;
    hints.ai_socktype = SOCK_STREAM;
    snprintf(service, sizeof service, "%d", port);
    if (getaddrinfo(host, service, &hints, &found) != 0) {
        snprintf(words, size, "host \"%.200s\" is unknown; expected a name or an address", host);
        return UUV_NO_SOCKET;
    }
    uuv_socket s = UUV_NO_SOCKET;
    for (struct addrinfo *a = found; a; a = a->ai_next) {
        s = socket(a->ai_family, a->ai_socktype, a->ai_protocol);
        if (s == UUV_NO_SOCKET) continue;
        socket_unblock(s);
        int error = 0;
        socklen_t length = sizeof error;
        const int done = connect(s, a->ai_addr, (socklen_t)a->ai_addrlen) == 0;
        if (done || (socket_again() && socket_wait(s, 1, end) &&
                     getsockopt(s, SOL_SOCKET, SO_ERROR, (char *)&error, &length) == 0 && !error))
            break;
        socket_close(s);
        s = UUV_NO_SOCKET;
    }
    freeaddrinfo(found);
    if (s == UUV_NO_SOCKET) {
        snprintf(words, size,
                 "nobody serves a co-simulation at %.200s, port %d; expected `uuvsim serve` there",
                 host, port);
        return s;
    }
    const int on = 1;
    setsockopt(s, IPPROTO_TCP, TCP_NODELAY, (const char *)&on, sizeof on);
#ifdef SO_NOSIGPIPE
    setsockopt(s, SOL_SOCKET, SO_NOSIGPIPE, &on, sizeof on);
#endif
    return s;
}

static int socket_send(uuv_socket s, const char *data, size_t size, double end) {
    while (size) {
        const int n = (int)send(s, data, size > 1 << 20 ? 1 << 20 : (int)size, UUV_NO_SIGNAL);
        if (n > 0) {
            data += n;
            size -= (size_t)n;
        } else if (!socket_again() || !socket_wait(s, 1, end)) {
            return 0;
        }
    }
    return 1;
}

/* 1: all came; 0: not before the end; -1: the other end has gone. */
static int socket_receive(uuv_socket s, char *data, size_t size, double end) {
    while (size) {
        const int n = (int)recv(s, data, size > 1 << 20 ? 1 << 20 : (int)size, 0);
        if (n > 0) {
            data += n;
            size -= (size_t)n;
        } else if (n == 0 || !socket_again()) {
            return -1;
        } else if (!socket_wait(s, 0, end)) {
            return 0;
        }
    }
    return 1;
}

#endif
