/* Fake autopilot for tests: speaks as ArduSub's SITL does, with a fault of the environment's choice.

   FAKE=fault:N does the fault at frame N: silent, dies, repeats, lost, restarts, short, long, magic,
   early, skips, flood, disarms, no_port, reports (its target, once); FAKE=polite ends, as ArduSub does, after the line of state that follows
   SIGTERM; FAKE=replay:FILE sends the pulse widths of a file. Without a fault it
   dives to 5 m. It writes what it receives into its folder: received.txt has the lines of state, and
   before each one the number of MAVLink bytes that were there when the line came; serial.bin has
   those bytes. */
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

static const char banner[] = "ArduSub V0.0 (fake)";
static int serial, out;
static FILE *bytes_log;
static struct sockaddr_in physics;
static uint8_t mode = 19, armed;

static volatile sig_atomic_t asked_to_end;

static void note_request(int number) {
    (void)number;
    asked_to_end = 1;
}

static uint16_t crc_of(const uint8_t *data, int n) {
    uint16_t crc = 0xffff;
    for (int i = 0; i < n; i++) {
        uint8_t t = data[i] ^ (uint8_t)crc;
        t ^= (uint8_t)(t << 4);
        crc = (uint16_t)((crc >> 8) ^ (t << 8) ^ (t << 3) ^ (t >> 4));
    }
    return crc;
}

/* Send a MAVLink 1 message; `extra` is the CRC_EXTRA of its kind. */
static void send_message(uint8_t kind, uint8_t extra, const uint8_t *payload, uint8_t size) {
    static uint8_t n;
    uint8_t m[270] = {0xfe, size, n++, 1, 1, kind};
    memcpy(m + 6, payload, size);
    m[6 + size] = extra; /* then overwritten */
    uint16_t crc = crc_of(m + 1, 6 + size);
    m[6 + size] = (uint8_t)crc, m[7 + size] = (uint8_t)(crc >> 8);
    (void)!write(serial, m, (size_t)size + 8);
}

static void heartbeat(void) {
    uint8_t payload[9] = {mode, 0, 0, 0, 12, 3, (uint8_t)(1 | armed << 7), 4, 3};
    send_message(0, 50, payload, sizeof payload);
}

/* Report the target N 1, E 2, D 3 m (POSITION_TARGET_LOCAL_NED). */
static void report_target(void) {
    uint8_t payload[51] = {0};
    float place[3] = {1, 2, 3};
    memcpy(payload + 4, place, sizeof place);
    payload[50] = 1;
    send_message(85, 140, payload, sizeof payload);
}

/* Read the serial port; obey COMMAND_LONG 176 (mode) and 400 (arm). Returns the number of bytes. */
static long listen_to_commands(void) {
    static uint8_t buffer[1 << 16];
    long n = recv(serial, buffer, sizeof buffer, MSG_DONTWAIT);
    if (n > 0) fwrite(buffer, 1, (size_t)n, bytes_log), fflush(bytes_log);
    for (long i = 0; i + 12 <= n;) {
        if (buffer[i] != 0xfd) { i++; continue; }
        uint8_t payload[256] = {0};
        memcpy(payload, buffer + i + 10, buffer[i + 1]);
        if (buffer[i + 7] == 76) {
            float p[2];
            memcpy(p, payload, sizeof p);
            uint16_t command = (uint16_t)(payload[28] | payload[29] << 8);
            if (command == 176) mode = (uint8_t)p[1];
            if (command == 400) armed = p[0] > 0;
        }
        i += 12 + buffer[i + 1];
    }
    return n > 0 ? n : 0;
}

static void send_packet(uint32_t frame, const uint16_t *widths, uint16_t magic, size_t size) {
    uint8_t packet[512] = {0};
    uint16_t rate = 400;
    memcpy(packet, &magic, 2), memcpy(packet + 2, &rate, 2), memcpy(packet + 4, &frame, 4);
    memcpy(packet + 8, widths, 32);
    sendto(out, packet, size, 0, (struct sockaddr *)&physics, sizeof physics);
}

int main(int argc, char **argv) {
    int instance = 0;
    for (int i = 1; i < argc; i++)
        if (!strncmp(argv[i], "-I", 2)) instance = atoi(argv[i] + 2);
    char fault[256] = "";
    long at = -1;
    FILE *recorded = NULL;
    if (getenv("FAKE")) {
        snprintf(fault, sizeof fault, "%s", getenv("FAKE"));
        char *colon = strchr(fault, ':');
        if (colon) {
            *colon = 0, at = atol(colon + 1);
            if (!strcmp(fault, "replay")) recorded = fopen(colon + 1, "rb");
        }
    }
    puts(banner);
    printf("serial port %d, physics port %d\n", 5760 + 10 * instance, 9002 + 10 * instance);
    fflush(stdout);
    if (!strcmp(fault, "no_port")) { puts("bind port failed"); return 1; }
    if (!strcmp(fault, "polite")) signal(SIGTERM, note_request);
    int door = socket(AF_INET, SOCK_STREAM, 0), on = 1;
    setsockopt(door, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    struct sockaddr_in here = {.sin_family = AF_INET, .sin_port = htons((uint16_t)(5760 + 10 * instance))};
    here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (bind(door, (struct sockaddr *)&here, sizeof here) || listen(door, 1)) return 2;
    serial = accept(door, NULL, NULL);
    setsockopt(serial, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    out = socket(AF_INET, SOCK_DGRAM, 0);
    physics = here, physics.sin_port = htons((uint16_t)(9002 + 10 * instance));
    FILE *log = fopen("received.txt", "w");
    bytes_log = fopen("serial.bin", "wb");
    double depth = 0;
    uint32_t frame = 0;
    for (;; frame++) {
        uint16_t widths[16];
        for (int i = 0; i < 16; i++) widths[i] = 1500;
        double push = 100 * (5 - depth);
        push = push > 400 ? 400 : push < -400 ? -400 : push;
        for (int i = 4; i < 8; i++) widths[i] = (uint16_t)(1500 + (armed ? push : 0));
        if (recorded && fread(widths, 2, 16, recorded) != 16) { puts("end of the recording"); return 0; }
        int now = (long)frame == at;
        if (now && !strcmp(fault, "dies")) { puts("segmentation fault"); fflush(stdout); abort(); }
        if (now && !strcmp(fault, "short")) send_packet(frame, widths, 18458, 39), send_packet(frame, widths, 18458, 3);
        if (now && !strcmp(fault, "long")) send_packet(frame, widths, 18458, 41), send_packet(frame, widths, 18458, 400);
        if (now && !strcmp(fault, "magic")) send_packet(frame, widths, 4711, 40);
        if (now && !strcmp(fault, "early")) send_packet(frame - 2, widths, 18458, 40);
        if (now && !strcmp(fault, "restarts")) send_packet(0, widths, 18458, 40);
        if (now && !strcmp(fault, "skips")) send_packet(frame + 5, widths, 18458, 40);
        while (now && !strcmp(fault, "flood")) send_packet(frame, widths, 1, 40);
        if (now && !strcmp(fault, "silent")) for (;;) sleep(1);
        send_packet(frame, widths, 18458, 40);
        if (now && !strcmp(fault, "repeats")) send_packet(frame, widths, 18458, 40);
        char line[4096];
        ssize_t n = recv(out, line, sizeof line - 1, 0);
        if (now && !strcmp(fault, "lost")) { /* the answer was lost: ask again */
            send_packet(frame, widths, 18458, 40);
            n = recv(out, line, sizeof line - 1, 0);
        }
        long bytes = listen_to_commands();
        if (n <= 0) return 3;
        line[n] = 0;
        fprintf(log, "%ld %s", bytes, line + 1);
        fflush(log);
        if (asked_to_end) { puts("ends between two loops"); return 0; }
        const char *p = strstr(line, "\"position\":[");
        double north, east;
        if (!p || sscanf(p, "\"position\":[%lf,%lf,%lf", &north, &east, &depth) != 3) return 4;
        if (now && !strcmp(fault, "disarms")) armed = 0, heartbeat();
        if (now && !strcmp(fault, "reports")) report_target();
        if (frame % 40 == 0) heartbeat();
    }
}
