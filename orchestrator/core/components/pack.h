/* Slots become arrays of a component's own types, and back. */
#ifndef UUV_CORE_PACK_H
#define UUV_CORE_PACK_H

#include "tables.h"

/* Width of FMI's Boolean: int in FMI 2.0, char in FMI 1.0, and bool in FMI 3.0. */
typedef enum { BOOLEAN_INT, BOOLEAN_BOOL } boolean_width;

/* Gives the array to hand to a setter (texts: of pointers, sizes in a->sizes), or NULL with the
 * slot of the value that does not fit in `why`. */
const void *pack(const access *a, const uuv_slot *slots, boolean_width width, uuv_failure *why);
/* Where a getter writes to, and what brings it into the slots; 0: no memory. */
void *unpack_buffer(const access *a, uuv_slot *slots);
int unpack(const access *a, uuv_slot *slots, boolean_width width);

#endif
