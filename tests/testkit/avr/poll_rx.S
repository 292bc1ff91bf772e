; Polls RXC; PB0 toggles within 5 cycles of each character; the characters and their flags go to
; SRAM from 0x100 (UCSR0A, UDR0). Waits WAIT x 5 cycles before it first looks.
.include "defs.inc"
.ifndef WAIT
.equ WAIT, 0
.endif
    sbi DDRB_io, 0
    usart_init 0x10
.if WAIT
    ldi r20, WAIT >> 16
    ldi r25, (WAIT >> 8) & 0xff
    ldi r24, WAIT & 0xff
4:  subi r24, 1
    sbci r25, 0
    sbci r20, 0
    brne 4b
.endif
    ldi r26, 0x00
    ldi r27, 0x01
1:  lds r17, UCSR0A
    sbrs r17, 7
    rjmp 1b
    sbi 0x03, 0
    lds r18, UDR0
    st X+, r17
    st X+, r18
    rjmp 1b
