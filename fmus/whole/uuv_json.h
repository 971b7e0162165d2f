/* SPDX-License-Identifier: Apache-2.0 */
/* As much of JSON as the answers of a server need: the values of an object's own keys.
 *
 * Numbers are read and written without the C library's locale, which importers change.
 */
#ifndef UUV_JSON_H
#define UUV_JSON_H

#include <stddef.h>
#include <stdio.h>
#include <string.h>

static const char *json_blank(const char *p) {
    while (*p == ' ' || *p == '\t' || *p == '\n' || *p == '\r' || *p == ',' || *p == ':') p++;
    return p;
}

/* Behind a text whose opening quote is at p. */
static const char *json_behind_text(const char *p) {
    for (p++; *p && *p != '"'; p++)
        if (*p == '\\' && p[1]) p++;
    return *p ? p + 1 : p;
}

/* Behind the value at p. */
static const char *json_behind(const char *p) {
    int depth = 0;
    do {
        if (*p == '"') {
            p = json_behind_text(p);
        } else if (*p == '{' || *p == '[') {
            depth++;
            p++;
        } else if (*p == '}' || *p == ']') {
            depth--;
            p++;
        } else if (depth) {
            p++;
        } else {
            while (*p && !strchr(",}] \t\r\n", *p)) p++;
        }
    } while (depth && *p);
    return p;
}

/* The value of a key of the object at p, or NULL. */
static const char *json_value(const char *p, const char *key) {
    const size_t n = strlen(key);
    p = json_blank(p);
    if (*p++ != '{') return NULL;
    for (p = json_blank(p); *p == '"'; p = json_blank(json_behind(p))) {
        const int mine = strncmp(p + 1, key, n) == 0 && p[1 + n] == '"';
        p = json_blank(json_behind_text(p));
        if (mine) return p;
    }
    return NULL;
}

static int json_is_true(const char *p) { return p && strncmp(p, "true", 4) == 0; }

static double json_number(const char *p) {
    double x = 0.0, unit = 1.0;
    int exponent = 0, negative = 0, behind = 0;
    if (!p) return 0.0;
    if (*p == '-') p++, unit = -1.0;
    for (; (*p >= '0' && *p <= '9') || *p == '.'; p++) {
        if (*p == '.') {
            behind = 1;
            continue;
        }
        x = 10.0 * x + (*p - '0');
        exponent -= behind;
    }
    if (*p == 'e' || *p == 'E') {
        int e = 0;
        p++;
        if (*p == '+' || *p == '-') negative = *p++ == '-';
        for (; *p >= '0' && *p <= '9' && e < 1000; p++) e = 10 * e + (*p - '0');
        exponent += negative ? -e : e;
    }
    for (; exponent > 0; exponent--) x *= 10.0;
    for (; exponent < 0; exponent++) x /= 10.0;
    return unit * x;
}

/* Copies a text without its escapes; other characters than ASCII stay as they are. */
static void json_text(const char *p, char *out, size_t size) {
    size_t n = 0;
    if (p && *p == '"')
        for (p++; *p && *p != '"' && n + 4 < size; p++) {
            unsigned code = 0;
            if (*p != '\\') {
                out[n++] = *p;
                continue;
            }
            switch (*++p) {
            case 'n': case 't': case 'r': case 'b': case 'f': out[n++] = ' '; break;
            case 'u':
                if (sscanf(p + 1, "%4x", &code) != 1) break;
                p += 4;
                if (code < 0x80) {
                    out[n++] = (char)code;
                } else if (code < 0x800) {
                    out[n++] = (char)(0xc0 | code >> 6);
                    out[n++] = (char)(0x80 | (code & 63));
                } else {
                    out[n++] = (char)(0xe0 | code >> 12);
                    out[n++] = (char)(0x80 | (code >> 6 & 63));
                    out[n++] = (char)(0x80 | (code & 63));
                }
                break;
            default: out[n++] = *p;
            }
            if (!*p) break;
        }
    if (size) out[n] = '\0';
}

/* Writes a text with quotes and escapes; gives 0 if there is no room. */
static int json_quote(const char *text, char *out, size_t size) {
    size_t n = 0;
    if (size < 3) return 0;
    out[n++] = '"';
    for (; *text; text++) {
        if (n + 8 > size) return 0;
        if (*text == '"' || *text == '\\')
            n += (size_t)snprintf(out + n, size - n, "\\%c", *text);
        else if ((unsigned char)*text < 0x20)
            n += (size_t)snprintf(out + n, size - n, "\\u%04x", (unsigned)*text);
        else
            out[n++] = *text;
    }
    out[n++] = '"';
    out[n] = '\0';
    return 1;
}

#endif
