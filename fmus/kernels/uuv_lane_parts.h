/* SPDX-License-Identifier: Apache-2.0 */
/* Steps of many blocks, of which only the cells that change or differ pass through memory.
 *
 * A step works in one block, `work`, which stays in the processor's cache. The parameters that all
 * lanes share are loaded into it once a call. Cells that change between the steps are in arrays of
 * their own, so that memory is read and written in order.
 *
 * Included by uuv_lane_blocks.h.
 */
#ifndef UUV_LANE_PARTS_H
#define UUV_LANE_PARTS_H

/* The cells of some ranges of every block, block by block. */
typedef struct {
    V *cells;
    const uint32_t *ranges; /* of each, the first cell of a block and the one after the last */
    uint64_t n_ranges, n_cells;
} uuv_lane_part;

typedef struct {
    uuv_lane_part carried; /* that a step changes and the next one reads */
    uuv_lane_part given;   /* that a step reads and does not change */
    uuv_lane_part kept;    /* that a step writes and no step reads */
} uuv_lane_parts;

/* A store past the cache, where the compiler has one. */
#if defined(__has_builtin)
#if __has_builtin(__builtin_nontemporal_store)
#define UUV_STORE_PAST(place, value) __builtin_nontemporal_store(value, &(place))
#endif
#endif
#if !defined(UUV_STORE_PAST)
#define UUV_STORE_PAST(place, value) (void)((place) = (value))
#endif

static inline void load_part(V *block, const uuv_lane_part *part, uint64_t i) {
    const V *from = part->cells + i * part->n_cells;
    for (uint64_t r = 0; r < part->n_ranges; r++)
        for (uint32_t k = part->ranges[2 * r]; k < part->ranges[2 * r + 1]; k++) block[k] = *from++;
}

static inline void store_part(const V *block, const uuv_lane_part *part, uint64_t i) {
    V *to = part->cells + i * part->n_cells;
    for (uint64_t r = 0; r < part->n_ranges; r++)
        for (uint32_t k = part->ranges[2 * r]; k < part->ranges[2 * r + 1]; k++) *to++ = block[k];
}

static inline void store_part_past(const V *block, const uuv_lane_part *part, uint64_t i) {
    V *to = part->cells + i * part->n_cells;
    for (uint64_t r = 0; r < part->n_ranges; r++)
        for (uint32_t k = part->ranges[2 * r]; k < part->ranges[2 * r + 1]; k++, to++)
            UUV_STORE_PAST(*to, block[k]);
}

/* The given variables that differ between lanes; those of the block after it are asked for. */
static inline void load_given(V *work, const uuv_lane_part *part, const uint8_t *is_own, uint64_t i,
                              int is_last) {
    const V *from = part->cells + i * part->n_cells;
    for (uint64_t r = 0; r < part->n_ranges; r++) {
        const uint32_t first = part->ranges[2 * r], n = part->ranges[2 * r + 1] - first;
        if (is_own[first]) {
            for (uint32_t k = 0; k < n; k++) work[first + k] = from[k];
            const char *next = (const char *)(from + part->n_cells);
            for (uint64_t k = 0; !is_last && k < n * sizeof(V); k += 64)
                __builtin_prefetch(next + k, 0, 3);
        }
        from += n;
    }
}

/* The parameters and derived values of the components that share them, or of the others. */
static inline void load_parameters(V *work, const V *m, const uint8_t *is_own, int own) {
    for (uint32_t i = 0; i < N_MEMBERS; i++) {
        const uuv_lane_component *c = declared[members[i].declaration];
        const uint32_t first = members[i].cell + c->off_parameters;
        if ((c->is_seeded || is_own[members[i].cell]) != own) continue;
        memcpy(work + first, m + first, (c->off_x - c->off_parameters) * sizeof(V));
    }
}

/* As uuv_kernel_step, for cells in parts; `memory` has the parameters, `work` room for a block. */
UUV_KERNEL_API int32_t uuv_kernel_step_parts(const V *memory, const uint8_t *is_own,
                                             const uuv_lane_parts *parts, V *work, uint64_t first,
                                             uint64_t last, uint64_t n) {
    int32_t failed = 0;
    const uint64_t lines = parts->carried.n_cells * sizeof(V) / 64 + 1;
    uuv_lane_fetch fetch = {0, 0, (lines << 32) / N_OPERATIONS};
    const uuv_lane_sources at = {0, 0, &fetch};
    load_parameters(work, memory, is_own, 0);
    load_part(work, &parts->given, 0);
    for (uint64_t i = first; i < last; i++) {
        load_part(work, &parts->carried, i);
        load_given(work, &parts->given, is_own, i, i + 1 == last);
        load_parameters(work, memory + i * N_CELLS, is_own, 1);
        for (uint64_t k = 0; k < n; k++) {
            if (k + 1 == n && i + 1 < last) {
                const V *next = parts->carried.cells + (i + 1) * parts->carried.n_cells;
                fetch.next = (const char *)next;
                fetch.end = (const char *)(next + parts->carried.n_cells);
            }
            step(work, &at);
        }
        store_part(work, &parts->carried, i);
        store_part_past(work, &parts->kept, i);
        failed |= uuv_any(~uuv_mask_of_words(uuv_words_equal(*lane_words(work, WORD_FAILED), 0)));
    }
    __atomic_thread_fence(__ATOMIC_SEQ_CST); /* other threads see what was stored past the cache */
    return failed;
}

/* Copies the cells of parts from whole blocks, or to them; of blocks with a mask that is not 0. */
UUV_KERNEL_API void uuv_kernel_copy_parts(V *memory, const uuv_lane_parts *parts, int32_t to_blocks,
                                          const uint8_t *masks, uint64_t first, uint64_t last) {
    const uuv_lane_part *each[] = {&parts->carried, &parts->given, &parts->kept};
    for (uint64_t i = first; i < last; i++) {
        int any = !masks;
        for (int lane = 0; masks && lane < UUV_W; lane++) any |= masks[i * UUV_W + (uint64_t)lane];
        for (int j = 0; any && j < 3; j++) {
            if (to_blocks)
                load_part(memory + i * N_CELLS, each[j], i);
            else
                store_part(memory + i * N_CELLS, each[j], i);
        }
    }
}

#endif
