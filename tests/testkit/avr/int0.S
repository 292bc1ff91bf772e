; Counts INT0 by the edges that SENSE says (ISC01, ISC00), asleep in between; the count is in SRAM.
.include "defs.inc"
    rjmp main
    .org 1 * 4
    lds r17, count
    inc r17
    sts count, r17
    reti
    .org 26 * 4
main:
    ldi r16, 0xff
    out SPL_io, r16
    ldi r16, 0x08
    out SPH_io, r16
    put count, 0
    ldi r16, SENSE
    sts 0x69, r16           ; EICRA
    sbi 0x1c, 0             ; EIFR
    sbi 0x1d, 0             ; EIMSK
    ldi r16, 1
    out SMCR_io, r16
    sei
1:  sleep
    rjmp 1b
    .lcomm count, 1
