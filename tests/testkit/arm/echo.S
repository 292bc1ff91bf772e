@ Sends back what comes in on USART1, and the same character with its highest bit inverted when it came with an error. Polls,
@ slowly enough not to be busy with registers alone.
 .syntax unified
 .cpu cortex-m4
 .thumb
 .section .vectors,"a"
 .word 0x20010000
 .word reset + 1

 .text
reset:
 ldr r0, =0x40011000    @ USART1
 ldr r1, =1094          @ 42 MHz / 38400
 str r1, [r0, #0x08]    @ BRR
 ldr r1, =0x200C        @ UE, TE, RE
 str r1, [r0, #0x0C]    @ CR1
wait:
 mov r2, #250
1: subs r2, #1
 bne 1b
 ldr r3, [r0]           @ SR
 tst r3, #0x20          @ RXNE
 beq wait
 ldr r4, [r0, #0x04]    @ DR
 tst r3, #0x0B          @ ORE, FE, PE
 it ne
 eorne r4, #0x80
 str r4, [r0, #0x04]
 b wait
