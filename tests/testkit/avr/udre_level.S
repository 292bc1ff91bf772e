; UDRE is level-triggered: with UDRIE on and UDR0 never written the handler runs again and again,
; one instruction of the main loop in between. r24 counts handlers until it is 5, then UDRIE goes
; off; the count is stored at 0x100, the instructions of the main program before the fifth at 0x101.
.include "defs.inc"
    rjmp main
    .org 19 * 4
    inc r24
    cpi r24, 5
    brne 1f
    mov r26, r25
    ldi r16, 0x08
    sts UCSR0B, r16
1:  reti
    .org 26 * 4
main:
    ldi r16, 0xff
    out SPL_io, r16
    ldi r16, 0x08
    out SPH_io, r16
    ldi r24, 0
    ldi r25, 0
    usart_init 0x28
    sei
    inc r25
    inc r25
    inc r25
    inc r25
    inc r25
    inc r25
    inc r25
    inc r25
    sts 0x100, r24
    sts 0x101, r26
9:  rjmp 9b
