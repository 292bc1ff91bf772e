; Writes 0x5a to EEPROM address 0x123, sleeps until EE_READY and reads it back; what it read goes to
; 0x100, PB0 up when the write starts, PB1 by the handler of EE_READY.
.include "defs.inc"
.equ EECR_io, 0x1f
.equ EEDR_io, 0x20
.equ EEARL_io, 0x21
.equ EEARH_io, 0x22
    rjmp main
    .org 22 * 4
    out EECR_io, r22        ; EERIE off
    out PORTB_io, r21
    reti
    .org 26 * 4
main:
    ldi r16, 0xff
    out SPL_io, r16
    ldi r16, 0x08
    out SPH_io, r16
    ldi r16, 3
    out DDRB_io, r16
    ldi r20, 1
    ldi r21, 3
    ldi r22, 0
    ldi r16, 1
    out SMCR_io, r16
    out EEARH_io, r16
    ldi r16, 0x23
    out EEARL_io, r16
    ldi r16, 0x5a
    out EEDR_io, r16
    sbi EECR_io, 2
    sbi EECR_io, 1
    out PORTB_io, r20
    out EEDR_io, r22
    sbi EECR_io, 3
    sei
    sleep
    sbi EECR_io, 0
    in r17, EEDR_io
    sts 0x100, r17
9:  rjmp 9b
