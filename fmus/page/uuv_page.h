/* SPDX-License-Identifier: Apache-2.0 */
/* A fused system in WebAssembly: the functions that a page, or node, calls.
 *
 * Included at the end of a generated file, after uuv_system.h. The caller writes inputs and
 * parameters into the block and reads outputs from it; `is_whole` says which shown outputs are
 * whole numbers. After each communication point, every output goes into the hash: each element has
 * a sum of its mixed bits, and the hash folds the sums. The file output_hash.py of
 * uuvsim_cosim/kernels/web_assembly computes the same hash from recorded outputs.
 */
#ifndef UUV_PAGE_H
#define UUV_PAGE_H

#define UUV_PAGE(name) __attribute__((export_name(#name), visibility("default"))) name

enum { N_SUMS = UUV_N_SUMS };
static whole *page;
static uint64_t sums[N_SUMS];
static char *page_state; /* a state of the instance, the sums, and the faults */

#include "uuv_page_faults.h"

static uint64_t mixed(uint64_t w) {
    w ^= w >> 32;
    w *= 0xbf58476d1ce4e5b9u;
    return w ^ w >> 29;
}

static void hash_outputs(void) {
    uint32_t j = 0;
    for (uint32_t i = 0; i < N_SHOWN; i++)
        for (uint32_t k = 0; k < shown_outputs[i].size; k++, j++) {
            const V x = page->m[shown_outputs[i].cell + k];
            const uint64_t bits = uuv_to_bits(is_whole[i] ? x + 0.0 : x); /* no -0 among them */
            sums[j] = sums[j] * 0x9e3779b97f4a7c15u + mixed(bits);
        }
}

/* Makes the instance, and returns its block of values; 0: out of memory. */
V *UUV_PAGE(uuv_page_open)(void) {
    page = (whole *)uuv_instantiate(&uuv_the_component);
    if (!page) return NULL;
    page_state = malloc(uuv_state_size(&page->head) + sizeof sums + sizeof faulty);
    return page_state ? page->head.b : NULL;
}

/* Begins at time 0 from the inputs and parameters in the block. */
void UUV_PAGE(uuv_page_begin)(void) {
    memset(page->m, 0, N_CELLS * sizeof(V));
    page->failure[0] = '\0';
    page->head.dirty = page->head.outputs_stale = 1;
    page->head.initialized = 0;
    clear_faults();
    uuv_enter_initialization(&page->head, 0.0);
    uuv_exit_initialization(&page->head);
    memset(sums, 0, sizeof sums);
    hash_outputs();
}

/* Makes n communication steps with the inputs and tunable parameters in the block; returns how many
 * were made: fewer if a value is not finite any more. */
uint32_t UUV_PAGE(uuv_page_run)(uint32_t n) {
    uint32_t made = 0;
    for (uint32_t i = 0; i < N_FREE; i++)
        page->m[free_inputs[i].cell] = page->head.b[free_inputs[i].b];
    copy_tunables(page);
    while (made < n && !page->failure[0]) {
        if (uuv_kernel_step(page->m, 0, 0, 1, 1)) note_failure(page);
        if (faulty.count) show_faults();
        hash_outputs();
        made++;
    }
    copy_outputs(page);
    page->head.b[0] = (double)(*lane_words(page->m, WORD_TICK) * tick_num) / (double)tick_den;
    return made;
}

/* The hash of all outputs at all communication points since the begin. */
uint64_t UUV_PAGE(uuv_page_hash)(void) {
    uint64_t h = N_SUMS;
    for (uint32_t j = 0; j < N_SUMS; j++) h = mixed(h * 0x9e3779b97f4a7c15u + sums[j]);
    return h;
}

/* Which value is not finite, as a text; empty: none. */
const char *UUV_PAGE(uuv_page_failure)(void) { return page->failure; }

/* The state that `save` writes and `restore` reads: its place, and its size in bytes. */
void *UUV_PAGE(uuv_page_state)(void) { return page_state; }
uint32_t UUV_PAGE(uuv_page_state_size)(void) {
    return (uint32_t)(uuv_state_size(&page->head) + sizeof sums + offsetof(active_faults, each) +
                      faulty.count * sizeof *faulty.each + faulty.n_past * sizeof *faulty.past);
}

/* Copies the parts of a state that are not the instance's, to or from p. */
static void copy_rest(char *p, void *(*copy)(char **p, void *part, size_t size)) {
    copy(&p, sums, sizeof sums);
    copy(&p, &faulty, offsetof(active_faults, each));
    copy(&p, faulty.each, faulty.count * sizeof *faulty.each);
    copy(&p, faulty.past, faulty.n_past * sizeof *faulty.past);
}
static void *copy_out(char **p, void *part, size_t size) {
    char *to = *p;
    *p += size;
    return memcpy(to, part, size);
}
static void *copy_in(char **p, void *part, size_t size) {
    const char *from = *p;
    *p += size;
    return memcpy(part, from, size);
}

void UUV_PAGE(uuv_page_save)(void) {
    uuv_get_state(&page->head, page_state);
    copy_rest(page_state + uuv_state_size(&page->head), copy_out);
}
void UUV_PAGE(uuv_page_restore)(void) {
    uuv_set_state(&page->head, page_state);
    copy_rest(page_state + uuv_state_size(&page->head), copy_in);
    bind_faults();
}

#endif
