/* Slots become arrays of a component's own types, and back. */
#include "pack.h"

#include <stdbool.h>
#include <string.h>

#define PACK(T, member, fits)                                                   \
    for (uint32_t i = 0; i < a->n_values; i++) {                                \
        if (!(fits)) {                                                          \
            why->slot = a->slot + i;                                            \
            failed(why, UUV_CORE_OUT_OF_RANGE, 0, UUV_CORE_SET);                \
            return NULL;                                                        \
        }                                                                       \
        ((T *)a->scratch)[i] = (T)from[i].member;                               \
    }                                                                           \
    break
#define UNPACK(T, member)                                                       \
    for (uint32_t i = 0; i < a->n_values; i++) to[i].member = ((const T *)a->scratch)[i]; \
    break

const void *pack(const access *a, const uuv_slot *slots, boolean_width width, uuv_failure *why) {
    const uuv_slot *from = slots + a->slot;
    switch (a->type) {
    case UUV_CORE_FLOAT64: case UUV_CORE_INT64: case UUV_CORE_UINT64: return from;
    case UUV_CORE_FLOAT32: PACK(float, f, 1);
    case UUV_CORE_INT8: PACK(int8_t, i, from[i].i == (int8_t)from[i].i);
    case UUV_CORE_INT16: PACK(int16_t, i, from[i].i == (int16_t)from[i].i);
    case UUV_CORE_INT32: PACK(int32_t, i, from[i].i == (int32_t)from[i].i);
    case UUV_CORE_UINT8: PACK(uint8_t, u, from[i].u == (uint8_t)from[i].u);
    case UUV_CORE_UINT16: PACK(uint16_t, u, from[i].u == (uint16_t)from[i].u);
    case UUV_CORE_UINT32: PACK(uint32_t, u, from[i].u == (uint32_t)from[i].u);
    case UUV_CORE_BOOLEAN:
        if (width == BOOLEAN_INT) { PACK(int, u, 1); }
        PACK(bool, u, 1);
    default:
        for (uint32_t i = 0; i < a->n_values; i++) {
            ((const char **)a->scratch)[i] = from[i].blob->data;
            a->sizes[i] = from[i].blob->size;
        }
    }
    return a->scratch;
}

void *unpack_buffer(const access *a, uuv_slot *slots) {
    const int direct = a->type == UUV_CORE_FLOAT64 || a->type == UUV_CORE_INT64 || a->type == UUV_CORE_UINT64;
    return direct ? (void *)(slots + a->slot) : a->scratch;
}

static int unpack_texts(const access *a, uuv_slot *to) {
    for (uint32_t i = 0; i < a->n_values; i++) {
        const char *text = ((const char **)a->scratch)[i];
        if (!text) text = "";
        const size_t size = a->type == UUV_CORE_STRING ? strlen(text) : a->sizes[i];
        if (!blob_assign(to[i].blob, text, size)) return 0;
    }
    return 1;
}

int unpack(const access *a, uuv_slot *slots, boolean_width width) {
    uuv_slot *to = slots + a->slot;
    switch (a->type) {
    case UUV_CORE_FLOAT64: case UUV_CORE_INT64: case UUV_CORE_UINT64: break;
    case UUV_CORE_FLOAT32: UNPACK(float, f);
    case UUV_CORE_INT8: UNPACK(int8_t, i);
    case UUV_CORE_INT16: UNPACK(int16_t, i);
    case UUV_CORE_INT32: UNPACK(int32_t, i);
    case UUV_CORE_UINT8: UNPACK(uint8_t, u);
    case UUV_CORE_UINT16: UNPACK(uint16_t, u);
    case UUV_CORE_UINT32: UNPACK(uint32_t, u);
    case UUV_CORE_BOOLEAN:
        for (uint32_t i = 0; i < a->n_values; i++)
            to[i].u = width == BOOLEAN_INT ? ((const int *)a->scratch)[i] != 0 : ((const unsigned char *)a->scratch)[i] != 0;
        break;
    default: return unpack_texts(a, to);
    }
    return 1;
}
